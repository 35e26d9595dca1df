/* soak.c: the firmware's filter and its float64 form side by side along a journey that repeats. Hand-written.
 *
 * FILTER names the generated filter, HEADER and HEADER_64 the headers of its two precisions, N_STATES how many states
 * there are, THETA and OMEGA which are angle and speed, ORDER whose rows LD has. One motor, one filter, step after step:
 * what runs a billion of them is the scalar form, so that a figure after a billion steps is one filter's. */
#include HEADER
#include HEADER_64
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#define LANES 16 /* streams of noise drawn at once */
#include "sensor_noise.h"

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define STATE JOIN(FILTER, _t)
#define STATE_64 JOIN(FILTER, _f64_t)
#define PACKED (N_STATES * (N_STATES + 1) / 2)

/* Rows of LD are those of these states. */
static const int order[N_STATES] = {ORDER};
static const double TWO_PI = 6.283185307179586;
static const double ROOT_3 = 1.7320508075688772;

/* Samples that one draw of noise serves: four normals a stream, two a sample. */
#define DRAWN (2 * LANES)
/* Steps between two looks at the covariance, which cost more than a step. */
#define LOOK 16

/* One period: see journey.py. */
typedef struct {
    int steps;
    const double *u;     /* V: alpha, beta of each interval */
    const double *i;     /* A: alpha, beta at 0 .. steps */
    const double *theta; /* rad, at 0 .. steps */
    const double *omega; /* rad/s, at 0 .. steps */
    double noise;        /* A rms of each of two phase-current sensors */
    int64_t lost_every;  /* every so many steps the currents are lost .. */
    int lost_for;        /* .. for so many */
    double slow;         /* rad/s: slower counts as near standstill */
} soak_journey;

/* Where a run is. */
typedef struct {
    STATE single;
    STATE_64 exact;
    int64_t at;      /* steps made */
    int k;           /* of them in this period */
    double turned;   /* rad: angle at the period's begin, in [-pi, pi] */
    uint32_t key[2][LANES];
    float normal[4][LANES];
} soak_state;

/* Largest ones and counts of a stretch of steps. */
typedef struct {
    double deviation[N_STATES]; /* |float32 - float64|, at speed */
    double slow[N_STATES];      /* the same where no current shows the angle: near standstill, and lost currents */
    double share[N_STATES];     /* of it, over float64's sigma; where the covariance was looked at */
    double covariance;          /* |P32 - P64| over sigma sigma */
    double angle, speed;        /* |estimate - truth|: rad, rad/s */
    int64_t rejected;           /* steps with lost currents, all of which say so */
    int64_t not_converged;      /* allowed: the last iterate was kept */
    int64_t unexpected;         /* steps with any other status than this journey gives reason for */
    int64_t first_unexpected;   /* step, counted from 1; 0: none */
    int bits;                   /* of the unexpected ones together */
    int64_t not_finite;         /* steps after which a number is none, in either precision */
} soak_figures;

static double wrapped(double angle)
{
    return angle - TWO_PI * rint(angle / TWO_PI);
}

static double size(double v)
{
    return (v < 0.0) ? -v : v;
}

/* NaN counts as largest. */
static void keep(double *largest, double value)
{
    if (!(value <= *largest)) {
        *largest = value;
    }
}

static void covariance(const double L[PACKED], double P[PACKED])
{
    int i, j, k;
    for (i = 0; i < N_STATES; i++) {
        for (j = 0; j <= i; j++) {
            double sum = 0.0;
            for (k = 0; k <= j; k++) {
                const double l_i = (k == i) ? 1.0 : L[i * (i + 1) / 2 + k];
                const double l_j = (k == j) ? 1.0 : L[j * (j + 1) / 2 + k];
                sum += l_i * L[k * (k + 3) / 2] * l_j;
            }
            P[i * (i + 1) / 2 + j] = sum;
        }
    }
}

static void look(const soak_state *s, const double deviation[N_STATES], soak_figures *f)
{
    double words[PACKED], P_32[PACKED], P_64[PACKED], sigma[N_STATES];
    int i, j;
    for (i = 0; i < PACKED; i++) {
        words[i] = (double)s->single.LD[i];
    }
    covariance(words, P_32);
    covariance(s->exact.LD, P_64);
    for (i = 0; i < N_STATES; i++) {
        sigma[i] = sqrt(P_64[i * (i + 3) / 2]);
        keep(&f->share[order[i]], deviation[order[i]] / sigma[i]);
        for (j = 0; j <= i; j++) {
            const int at = i * (i + 1) / 2 + j;
            keep(&f->covariance, size(P_32[at] - P_64[at]) / (sigma[i] * sigma[j]));
        }
    }
}

static void compare(const soak_state *s, double theta, double omega, int unseen, soak_figures *f)
{
    double deviation[N_STATES];
    double *largest = (unseen != 0) ? f->slow : f->deviation;
    double sum = 0.0;
    int i;
    for (i = 0; i < N_STATES; i++) {
        const double off = (double)s->single.x[i] - s->exact.x[i];
        deviation[i] = size((i == THETA) ? wrapped(off) : off);
        keep(&largest[i], deviation[i]);
        sum += off;
    }
    keep(&f->angle, size(wrapped((double)s->single.x[THETA] - theta)));
    keep(&f->speed, size((double)s->single.x[OMEGA] - omega));
    if (!(sum - sum == 0.0)) {
        f->not_finite++;
    }
    if (s->at % LOOK == 0) {
        look(s, deviation, f);
    }
}

static void judge(soak_state *s, int status, int lost, soak_figures *f)
{
    const int wanted = (lost != 0) ? PMSM_INPUT_REJECTED : 0;
    if ((status & PMSM_NOT_CONVERGED) != 0) {
        f->not_converged++;
    }
    if ((status & ~PMSM_NOT_CONVERGED) != wanted) {
        f->unexpected++;
        f->bits |= (status & ~PMSM_NOT_CONVERGED) ^ wanted;
        if (f->first_unexpected == 0) {
            f->first_unexpected = s->at;
        }
    } else if (lost != 0) {
        f->rejected++;
    }
}

/* The next sample's noise of sensors a and b, standard normals. */
static void draw(soak_state *s, double normal[2])
{
    const int slot = (int)(s->at % DRAWN);
    if (slot == 0) {
        noise_words words[4];
        philox(s->key[0], s->key[1], (uint32_t)(s->at / DRAWN), words);
        box_muller(&words[0], s->normal[0], s->normal[1]);
        box_muller(&words[2], s->normal[2], s->normal[3]);
    }
    normal[0] = (double)s->normal[2 * (slot / LANES)][slot % LANES];
    normal[1] = (double)s->normal[2 * (slot / LANES) + 1][slot % LANES];
}

/* Two phase currents with noise, and what Clarke makes of them. */
static void sense(double i_alpha, double i_beta, const double noise[2], float32 y[2])
{
    const double i_a = i_alpha + noise[0];
    const double i_b = 0.5 * (ROOT_3 * i_beta - i_alpha) + noise[1];
    y[0] = (float32)i_a;
    y[1] = (float32)((i_a + 2.0 * i_b) / ROOT_3);
}

/* One sample of the journey, both filters, all judgements. */
static void sample(const soak_journey *j, soak_state *s, double cosine, double sine, soak_figures *f)
{
    const int k = s->k;
    const double *v = &j->u[2 * k], *i = &j->i[2 * (k + 1)];
    const int64_t since = s->at % j->lost_every; /* from the end of one loss */
    const int lost = (since >= j->lost_every - j->lost_for) ? 1 : 0;
    const int found = (since < j->lost_for) ? 1 : 0; /* as long again for what was lost */
    const double omega = j->omega[k + 1];
    const int unseen = ((size(omega) < j->slow) || (lost != 0) || (found != 0)) ? 1 : 0;
    double normal[2], u_64[2], y_64[2];
    float32 u[2], y[2];
    int status;
    draw(s, normal);
    normal[0] = j->noise * normal[0];
    normal[1] = j->noise * normal[1];
    u[0] = (float32)(cosine * v[0] - sine * v[1]);
    u[1] = (float32)(sine * v[0] + cosine * v[1]);
    sense(cosine * i[0] - sine * i[1], sine * i[0] + cosine * i[1], normal, y);
    if (lost != 0) {
        y[s->at % 2] = (float32)NAN;
    }
    u_64[0] = (double)u[0];
    u_64[1] = (double)u[1];
    y_64[0] = (double)y[0];
    y_64[1] = (double)y[1];
    status = JOIN(FILTER, _step)(&s->single, u, y);
    (void)JOIN(FILTER, _f64_step)(&s->exact, u_64, y_64);
    s->at++;
    compare(s, wrapped(j->theta[k + 1] + s->turned), omega, unseen, f);
    judge(s, status, lost, f);
}

void soak_begin(soak_state *s, uint64_t seed)
{
    int lane;
    memset(s, 0, sizeof(*s));
    JOIN(FILTER, _init)(&s->single);
    JOIN(FILTER, _f64_init)(&s->exact);
    for (lane = 0; lane < LANES; lane++) {
        s->key[0][lane] = (uint32_t)(seed + (uint64_t)lane);
        s->key[1][lane] = (uint32_t)((seed + (uint64_t)lane) >> 32);
    }
}

/* So many steps more; figures are added to what is in f. Returns the angle at the period's begin, rad. */
double soak_run(const soak_journey *j, soak_state *s, int64_t count, soak_figures *f)
{
    while (count > 0) {
        const double cosine = cos(s->turned), sine = sin(s->turned);
        for (; s->k < j->steps && count > 0; s->k++, count--) {
            sample(j, s, cosine, sine, f);
        }
        if (s->k == j->steps) {
            s->k = 0;
            s->turned = wrapped(s->turned + j->theta[j->steps]);
        }
    }
    return s->turned;
}

int soak_size(void)
{
    return (int)sizeof(soak_state);
}
