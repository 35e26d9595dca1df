/* runner.c: host side of the C back end. Runs lanes of one generated filter over a trajectory, one after the other.
 * Hand-written; compiled beside the generated .c, which stays untouched.
 * FILTER names the generated filter (as in FILTER_t, FILTER_step), HEADER its header, REAL its number type,
 * COVARIANCE the field that carries P. */
#include HEADER
#include <stddef.h>

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define STATE JOIN(FILTER, _t)
#define STEP JOIN(FILTER, _step)

#define LENGTH(field) ((int)(sizeof(((STATE *)0)->field) / sizeof(REAL)))

/* One step of one filter, all its arguments in one place: a call from Python pays for each argument. */
typedef struct {
    STATE *filter;
    REAL inputs[4]; /* u, then y */
} runner_call_t;

int runner_step(runner_call_t *call)
{
    return STEP(call->filter, &call->inputs[0], &call->inputs[2]);
}

/* Lanes first .. first + count - 1 of `batch`. u, y: [steps][2][batch]. Outputs of each step, or with last_only of
 * the last one: x, words [.][n or packed][batch], iterations, status [.][batch]. */
void runner_run(STATE *f, int first, int count, int batch, int steps, const REAL *u, const REAL *y, int last_only,
                REAL *x, REAL *words, int *iterations, int *status)
{
    const size_t row = (size_t)batch;
    int k, b, i;
    for (k = 0; k < steps; k++) {
        const size_t out = (last_only != 0) ? 0 : (size_t)k;
        for (b = first; b < first + count; b++) {
            REAL u_lane[2], y_lane[2];
            for (i = 0; i < 2; i++) {
                u_lane[i] = u[((size_t)k * 2 + i) * row + b];
                y_lane[i] = y[((size_t)k * 2 + i) * row + b];
            }
            status[out * row + b] = STEP(&f[b], u_lane, y_lane);
            iterations[out * row + b] = f[b].iterations;
            for (i = 0; i < LENGTH(x); i++) {
                x[(out * LENGTH(x) + i) * row + b] = f[b].x[i];
            }
            for (i = 0; i < LENGTH(COVARIANCE); i++) {
                words[(out * LENGTH(COVARIANCE) + i) * row + b] = f[b].COVARIANCE[i];
            }
        }
    }
}
