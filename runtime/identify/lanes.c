/* lanes.c: one recording through LANES filters of other motor data, side by side. Hand-written around the step, which
 * is printed from the equations. */
#include <math.h>
#include <string.h>

typedef struct { double of[LANES]; } lanes;

static void innovate(const lanes *__restrict p, const lanes *__restrict s, const double *__restrict row,
                     lanes *__restrict s_out, lanes *__restrict told)
{
    int l;
    for (l = 0; l < LANES; l++) {
        /* the step */
    }
}

/* rows: [steps][ROW_LENGTH]; parameters: [PARAMETERS][LANES]; state: [STATE_LENGTH][LANES], changed;
 * told: [steps][TOLD_LENGTH][LANES]. */
void innovate_run(int steps, const double *rows, const double *parameters, double *state, double *told)
{
    lanes s[2][STATE_LENGTH], p[PARAMETERS];
    int k;
    memcpy(p, parameters, sizeof(p));
    memcpy(s[0], state, sizeof(s[0]));
    for (k = 0; k < steps; k++) {
        innovate(p, s[k & 1], &rows[(long)k * ROW_LENGTH], s[(k + 1) & 1],
                 (lanes *)&told[(long)k * TOLD_LENGTH * LANES]);
    }
    memcpy(state, s[steps & 1], sizeof(s[0]));
}
