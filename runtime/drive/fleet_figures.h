/* fleet_figures.h: what fleet.c keeps of a sample. Hand-written; needs its group and task. */
#ifndef FLEET_FIGURES_H
#define FLEET_FIGURES_H

/* Errors of the estimate at sample k; keeps when the lock was last broken, status and finiteness. */
static void judge(group *__restrict g, const fleet_task *__restrict t, int k, lanes_f64 *__restrict speed_error,
                  lanes_f64 *__restrict angle_error)
{
    int lane;
    for (lane = 0; lane < LANES; lane++) {
        const double omega = (double)FILTER_OF(&g->drive).x[2].of[lane];
        const double theta = (double)FILTER_OF(&g->drive).x[3].of[lane];
        const double wanted = g->speed.of[lane];
        const double off = theta - g->s[3].of[lane];
        const double turned = off - TWO_PI * (off / TWO_PI + ROUND_64 - ROUND_64);
        const double angle = (turned < 0.0) ? -turned : turned;
        const double along = (wanted < 0.0) ? -g->s[2].of[lane] : g->s[2].of[lane];
        const double size = (wanted < 0.0) ? -wanted : wanted;
        const int bad = ((angle <= t->locked_angle) ? 0 : 1) | ((along >= -t->wrong_way * size) ? 0 : 1);
        const double error = omega - g->s[2].of[lane];
        const int from = g->flags[LOCKED_FROM][lane];
        speed_error->of[lane] = (error < 0.0) ? -error : error;
        angle_error->of[lane] = angle;
        g->flags[LOCKED_FROM][lane] = (bad != 0) ? k + 1 : from;
        g->flags[STATUS][lane] |= g->drive.status[lane];
        g->flags[FINITE][lane] &= ((error - error == 0.0) ? 1 : 0) & ((off - off == 0.0) ? 1 : 0);
    }
}

static void keep_largest(lanes_f64 *__restrict largest, const lanes_f64 *__restrict value)
{
    int lane;
    for (lane = 0; lane < LANES; lane++) {
        const double old = largest->of[lane];
        largest->of[lane] = (value->of[lane] > old) ? value->of[lane] : old;
    }
}

static void keep_largest_loaded(lanes_f64 *__restrict largest, const lanes_f64 *__restrict value,
                                const lanes_f64 *__restrict load)
{
    int lane;
    for (lane = 0; lane < LANES; lane++) {
        const double old = largest->of[lane];
        const int more = ((value->of[lane] > old) ? 1 : 0) & ((load->of[lane] != 0.0) ? 1 : 0);
        largest->of[lane] = (more != 0) ? value->of[lane] : old;
    }
}

/* The last 50 ms: squares for the rms, and whether speed and angle stay where they should be. */
static void keep_late(group *__restrict g, const lanes_f64 *__restrict speed_error,
                      const lanes_f64 *__restrict angle_error)
{
    int lane;
    for (lane = 0; lane < LANES; lane++) {
        const double error = speed_error->of[lane];
        const double off = g->s[2].of[lane] - g->speed.of[lane];
        const double size = (off < 0.0) ? -off : off;
        const double largest = g->figures[LATE_SPEED].of[lane];
        const double widest = g->figures[LATE_ANGLE].of[lane];
        g->figures[LATE_SQUARE].of[lane] += error * error;
        g->figures[LATE_SPEED].of[lane] = (size > largest) ? size : largest;
        g->figures[LATE_ANGLE].of[lane] = (angle_error->of[lane] > widest) ? angle_error->of[lane] : widest;
    }
}

static void judge_sample(group *g, const fleet_task *t, int k)
{
    lanes_f64 speed_error, angle_error;
    judge(g, t, k, &speed_error, &angle_error);
    if (k < t->start_until) {
        keep_largest(&g->figures[START], &speed_error);
    }
    if (k >= t->after_from) {
        keep_largest_loaded(&g->figures[AFTER], &speed_error, &g->load);
    }
    if (k >= t->moving_from) {
        keep_largest(&g->figures[ANGLE], &angle_error);
    }
    if (k >= t->late_from) {
        keep_largest(&g->figures[AFTER], &speed_error);
        keep_late(g, &speed_error, &angle_error);
    }
    g->figures[ANGLE_END] = angle_error;
}

#endif
