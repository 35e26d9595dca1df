/* lanes_runner.c: runs a batch of filters over a trajectory with the generated lane form.
 * Hand-written; compiled beside the generated .c, which stays untouched.
 * FILTER names the generated filter (FILTER_t, FILTER_lanes_t, FILTER_lanes_step), HEADER and LANES_HEADER its
 * headers, COVARIANCE the field that carries P. The scalar structs are where the batch comes from and goes to. */
#include HEADER
#include LANES_HEADER
#include <string.h>

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define STATE JOIN(FILTER, _t)
#define LANES_STATE JOIN(FILTER, _lanes_t)
#define LANES_STEP JOIN(FILTER, _lanes_step)

/* Groups that take turns: few enough to stay in the first-level cache, enough to write output in long rows. */
#define GROUPS 32

#define LENGTH(field) ((int)(sizeof(((STATE *)0)->field) / sizeof(float32)))

/* Lanes beyond count repeat the last one. */
static int lane_of(int lane, int count)
{
    return (lane < count) ? lane : count - 1;
}

static void load(LANES_STATE *g, const STATE *f, int count)
{
    int i, l;
    for (l = 0; l < LANES; l++) {
        const STATE *s = &f[lane_of(l, count)];
        for (i = 0; i < LENGTH(x); i++) {
            g->x[i].of[l] = s->x[i];
            g->Q[i].of[l] = s->Q[i];
#ifdef GUARDED
            g->x_0[i].of[l] = s->x_0[i];
            g->P_0[i].of[l] = s->P_0[i];
#endif
        }
        for (i = 0; i < LENGTH(COVARIANCE); i++) {
            g->COVARIANCE[i].of[l] = s->COVARIANCE[i];
        }
        for (i = 0; i < 2; i++) {
            g->R[i].of[l] = s->R[i];
            g->u_held[i].of[l] = s->u_held[i];
        }
        g->u_max[0].of[l] = s->u_max;
        g->y_max[0].of[l] = s->y_max;
        g->tolerance[0].of[l] = s->tolerance;
        g->max_iterations[l] = s->max_iterations;
#ifdef GUARDED
        g->nis_max[0].of[l] = s->nis_max;
        g->nis_weight[0].of[l] = s->nis_weight;
        g->nis[0].of[l] = s->nis;
        g->repairs[l] = s->repairs;
#endif
        g->iterations[l] = s->iterations;
        g->status[l] = 0;
    }
}

static void store(const LANES_STATE *g, STATE *f, int count)
{
    int i, l;
    for (l = 0; l < count; l++) {
        for (i = 0; i < LENGTH(x); i++) {
            f[l].x[i] = g->x[i].of[l];
        }
        for (i = 0; i < LENGTH(COVARIANCE); i++) {
            f[l].COVARIANCE[i] = g->COVARIANCE[i].of[l];
        }
        for (i = 0; i < 2; i++) {
            f[l].u_held[i] = g->u_held[i].of[l];
        }
        f[l].iterations = g->iterations[l];
#ifdef GUARDED
        f[l].nis = g->nis[0].of[l];
        f[l].repairs = g->repairs[l];
#endif
    }
}

static void read_row(lanes *target, const float32 *row, int count)
{
    int l;
    if (count == LANES) {
        memcpy(target->of, row, sizeof(target->of));
        return;
    }
    for (l = 0; l < LANES; l++) {
        target->of[l] = row[lane_of(l, count)];
    }
}

/* Numbers of both types are 4 bytes long. */
static void write_row(void *row, const void *of, int count)
{
    if (count == LANES) {
        memcpy(row, of, sizeof(lanes));
    } else {
        memcpy(row, of, (size_t)count * sizeof(float32));
    }
}

/* Lanes first .. first + count - 1 of `batch`. u, y: [steps][2][batch]. Outputs of each step, or with last_only of
 * the last one: x, words [.][n or packed][batch], iterations, status [.][batch]. */
void lanes_run(STATE *f, int first, int count, int batch, int steps, const float32 *u, const float32 *y, int last_only,
               float32 *x, float32 *words, int *iterations, int *status)
{
    LANES_STATE groups[GROUPS];
    const size_t row = (size_t)batch;
    int begin;
    for (begin = first; begin < first + count; begin += GROUPS * LANES) {
        const int left = first + count - begin;
        const int here = (left < GROUPS * LANES) ? left : GROUPS * LANES;
        int b, k, i;
        for (b = 0; b < here; b += LANES) {
            load(&groups[b / LANES], &f[begin + b], (here - b < LANES) ? here - b : LANES);
        }
        for (k = 0; k < steps; k++) {
            const size_t out = (last_only != 0) ? 0 : (size_t)k;
            for (b = 0; b < here; b += LANES) {
                LANES_STATE *g = &groups[b / LANES];
                const int n = (here - b < LANES) ? here - b : LANES;
                const size_t at = (size_t)(begin + b);
                lanes u_now[2], y_now[2];
                for (i = 0; i < 2; i++) {
                    read_row(&u_now[i], &u[((size_t)k * 2 + i) * row + at], n);
                    read_row(&y_now[i], &y[((size_t)k * 2 + i) * row + at], n);
                }
                LANES_STEP(g, u_now, y_now);
                if (last_only != 0 && k + 1 < steps) {
                    continue;
                }
                for (i = 0; i < LENGTH(x); i++) {
                    write_row(&x[(out * LENGTH(x) + i) * row + at], g->x[i].of, n);
                }
                for (i = 0; i < LENGTH(COVARIANCE); i++) {
                    write_row(&words[(out * LENGTH(COVARIANCE) + i) * row + at], g->COVARIANCE[i].of, n);
                }
                write_row(&iterations[out * row + at], g->iterations, n);
                write_row(&status[out * row + at], g->status, n);
            }
        }
        for (b = 0; b < here; b += LANES) {
            store(&groups[b / LANES], &f[begin + b], (here - b < LANES) ? here - b : LANES);
        }
    }
}

/* How many lanes make a group. */
int lanes_group(void)
{
    return LANES;
}
