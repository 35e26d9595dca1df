/* runner.c: host side of the C back end. Runs lanes of one generated filter over a trajectory.
 * Hand-written; compiled beside the generated .c, which stays untouched.
 * FILTER names the generated filter (as in FILTER_t, FILTER_step), HEADER its header, REAL its number type,
 * COVARIANCE the field that carries P. */
#include HEADER

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define STATE JOIN(FILTER, _t)
#define STEP JOIN(FILTER, _step)

/* u, y: [steps][2][lanes]; x, words: [steps][n or packed][lanes]; iterations, status: [steps][lanes]. */
void runner_run(STATE *f, int lanes, int steps, int n, int packed, const REAL *u, const REAL *y, REAL *x, REAL *words,
                int *iterations, int *status)
{
    int k, b, i;
    for (k = 0; k < steps; k++) {
        for (b = 0; b < lanes; b++) {
            REAL u_lane[2], y_lane[2];
            for (i = 0; i < 2; i++) {
                u_lane[i] = u[i * lanes + b];
                y_lane[i] = y[i * lanes + b];
            }
            status[b] = STEP(&f[b], u_lane, y_lane);
            iterations[b] = f[b].iterations;
            for (i = 0; i < n; i++) {
                x[i * lanes + b] = f[b].x[i];
            }
            for (i = 0; i < packed; i++) {
                words[i * lanes + b] = f[b].COVARIANCE[i];
            }
        }
        u += 2 * lanes;
        y += 2 * lanes;
        x += n * lanes;
        words += packed * lanes;
        iterations += lanes;
        status += lanes;
    }
}
