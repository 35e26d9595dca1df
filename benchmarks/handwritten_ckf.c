/* handwritten_ckf.c: the iterated cubature Kalman filter of paper_spmsm, written by hand.
 *
 * The code a good engineer makes of the paper's equations (in brackets) in an afternoon: float, loops over states and
 * points, motor data folded by the compiler, covariances as centred sums, nothing computed twice on purpose.
 * Sine, cosine and the wrapping of theta are the generated filters' own (trig.h), so that no libm decides.
 */
#include "handwritten_ckf.h"
#include "trig.h"

#define N 4
#define POINTS (2 * N)
#define OUTPUTS 2
#ifndef N_MAX
#define N_MAX 1
#endif

/* Motor, SI. */
#define T 20e-6f
#define RS 2.875f
#define LS 835e-6f
#define PSI 0.175f
#define POLES 4.0f
#define J 0.008f
#define D 0.002f

#define DECAY_I (1.0f - T * RS / LS)
#define GAIN_E (T * PSI * POLES / LS)
#define GAIN_V (T / LS)
#define DECAY_OMEGA (1.0f - T * D / J)

/* (13), (18): S S^T = P, lower triangle. */
static void cholesky(float32 P[N][N], float32 S[N][N])
{
    int i, j, k;
    for (j = 0; j < N; j++) {
        float32 sum = P[j][j];
        float32 inverse;
        for (k = 0; k < j; k++) {
            sum -= S[j][k] * S[j][k];
        }
        S[j][j] = PMSM_SQRT(sum);
        inverse = 1.0f / S[j][j];
        for (i = j + 1; i < N; i++) {
            sum = P[i][j];
            for (k = 0; k < j; k++) {
                sum -= S[i][k] * S[j][k];
            }
            S[i][j] = sum * inverse;
        }
    }
}

/* (14), (19): x +- sqrt(n) S_c; above the diagonal S is zero. */
static void draw(const float32 x[N], float32 S[N][N], float32 X[POINTS][N])
{
    int c, i;
    for (c = 0; c < N; c++) {
        for (i = 0; i < c; i++) {
            X[c][i] = x[i];
            X[c + N][i] = x[i];
        }
        for (i = c; i < N; i++) {
            const float32 d = 2.0f * S[i][c];
            X[c][i] = x[i] + d;
            X[c + N][i] = x[i] - d;
        }
    }
}

/* (7) */
static void propagate(const float32 x[N], const float32 v[2], float32 next[N])
{
    const pmsm_pair rotor = sin_cos(wrap_angle(x[3]));
    const float32 emf = GAIN_E * x[2];
    next[0] = DECAY_I * x[0] + emf * rotor.sine + v[0];
    next[1] = DECAY_I * x[1] - emf * rotor.cosine + v[1];
    next[2] = DECAY_OMEGA * x[2];
    next[3] = x[3] + T * POLES * x[2];
}

/* (15)-(17) */
static void predict(float32 X[POINTS][N], const float32 u[2], const float32 Q[N], float32 x[N], float32 P[N][N])
{
    float32 v[2];
    int i, j, k;
    v[0] = GAIN_V * u[0];
    v[1] = GAIN_V * u[1];
    for (i = 0; i < N; i++) {
        x[i] = 0.0f;
    }
    for (k = 0; k < POINTS; k++) {
        float32 next[N];
        propagate(X[k], v, next);
        for (i = 0; i < N; i++) {
            X[k][i] = next[i];
            x[i] += next[i];
        }
    }
    for (i = 0; i < N; i++) {
        x[i] *= 1.0f / POINTS;
        for (j = 0; j < N; j++) {
            P[i][j] = 0.0f;
        }
    }
    for (k = 0; k < POINTS; k++) {
        for (i = 0; i < N; i++) {
            X[k][i] -= x[i];
        }
        for (i = 0; i < N; i++) {
            for (j = 0; j <= i; j++) {
                P[i][j] += X[k][i] * X[k][j];
            }
        }
    }
    for (i = 0; i < N; i++) {
        for (j = 0; j <= i; j++) {
            P[i][j] *= 1.0f / POINTS;
            P[j][i] = P[i][j];
        }
        P[i][i] += Q[i];
    }
}

/* (20)-(24) about x: Pyy, Pxy, the gain. The measured currents are the first two states. */
static void gain(float32 X[POINTS][N], const float32 x[N], const float32 R[2], float32 K[N][2], float32 Pyy[2][2])
{
    float32 Pxy[N][OUTPUTS];
    float32 y_mean[OUTPUTS];
    float32 inverse;
    int i, j, k;
    for (j = 0; j < OUTPUTS; j++) {
        y_mean[j] = 0.0f;
        for (k = 0; k < POINTS; k++) {
            y_mean[j] += X[k][j];
        }
        y_mean[j] *= 1.0f / POINTS;
        for (i = 0; i < N; i++) {
            Pxy[i][j] = 0.0f;
        }
    }
    Pyy[0][0] = 0.0f;
    Pyy[1][0] = 0.0f;
    Pyy[1][1] = 0.0f;
    for (k = 0; k < POINTS; k++) {
        const float32 dy_0 = X[k][0] - y_mean[0];
        const float32 dy_1 = X[k][1] - y_mean[1];
        Pyy[0][0] += dy_0 * dy_0;
        Pyy[1][0] += dy_1 * dy_0;
        Pyy[1][1] += dy_1 * dy_1;
        for (i = 0; i < N; i++) {
            const float32 dx = X[k][i] - x[i];
            Pxy[i][0] += dx * dy_0;
            Pxy[i][1] += dx * dy_1;
        }
    }
    Pyy[0][0] = Pyy[0][0] * (1.0f / POINTS) + R[0];
    Pyy[1][0] = Pyy[1][0] * (1.0f / POINTS);
    Pyy[0][1] = Pyy[1][0];
    Pyy[1][1] = Pyy[1][1] * (1.0f / POINTS) + R[1];
    inverse = (1.0f / POINTS) / (Pyy[0][0] * Pyy[1][1] - Pyy[1][0] * Pyy[1][0]);
    for (i = 0; i < N; i++) {
        K[i][0] = (Pxy[i][0] * Pyy[1][1] - Pxy[i][1] * Pyy[1][0]) * inverse;
        K[i][1] = (Pxy[i][1] * Pyy[0][0] - Pxy[i][0] * Pyy[1][0]) * inverse;
    }
}

/* (28)-(34): iterates about x^j, then the covariance of the last. */
static int update(handwritten_ckf_t *f, const float32 x_pred[N], float32 P_pred[N][N], const float32 y[2])
{
    float32 S[N][N], X[POINTS][N], K[N][OUTPUTS], Pyy[OUTPUTS][OUTPUTS], x[N];
    float32 change;
    int i, j, iterations = 0;
    cholesky(P_pred, S);
    for (i = 0; i < N; i++) {
        x[i] = x_pred[i];
    }
    do {
        float32 nu[OUTPUTS];
        draw(x, S, X);
        gain(X, x, f->R, K, Pyy);
        for (j = 0; j < OUTPUTS; j++) {
            nu[j] = y[j] - x[j] - (x_pred[j] - x[j]);
        }
        change = 0.0f;
        for (i = 0; i < N; i++) {
            const float32 next = x_pred[i] + K[i][0] * nu[0] + K[i][1] * nu[1];
            change += (next - x[i]) * (next - x[i]);
            x[i] = next;
        }
        iterations++;
    } while (iterations < f->max_iterations && change > f->tolerance * f->tolerance);
    for (i = 0; i < N; i++) {
        const float32 a = K[i][0] * Pyy[0][0] + K[i][1] * Pyy[1][0];
        const float32 b = K[i][0] * Pyy[0][1] + K[i][1] * Pyy[1][1];
        for (j = 0; j <= i; j++) {
            f->P[N * i + j] = P_pred[i][j] - (a * K[j][0] + b * K[j][1]);
            f->P[N * j + i] = f->P[N * i + j];
        }
        f->x[i] = x[i];
    }
    f->x[3] = wrap_angle(f->x[3]);
    return iterations;
}

void handwritten_ckf_init(handwritten_ckf_t *f)
{
    static const float32 Q[N] = { 0.01f, 0.02f, 0.24f, 0.001f };
    int i;
    for (i = 0; i < N; i++) {
        f->Q[i] = Q[i];
    }
    f->R[0] = 0.01f;
    f->R[1] = 0.01f;
    f->tolerance = 1e-6f;
    f->max_iterations = N_MAX;
    handwritten_ckf_reset(f);
}

void handwritten_ckf_reset(handwritten_ckf_t *f)
{
    static const float32 P_0[N] = { 0.1f, 0.1f, 50.0f, 0.1f };
    int i, j;
    for (i = 0; i < N; i++) {
        f->x[i] = 0.0f;
        for (j = 0; j < N; j++) {
            f->P[N * i + j] = (i == j) ? P_0[i] : 0.0f;
        }
    }
}

int handwritten_ckf_step(handwritten_ckf_t *f, const float32 u[2], const float32 y[2])
{
    float32 P[N][N], S[N][N], X[POINTS][N], x_pred[N];
    int i, j;
    for (i = 0; i < N; i++) {
        for (j = 0; j < N; j++) {
            P[i][j] = f->P[N * i + j];
        }
    }
    cholesky(P, S);
    draw(f->x, S, X);
    predict(X, u, f->Q, x_pred, P);
    return update(f, x_pred, P, y);
}
