/* fleet.c: closed loops side by side, LANES at a time. Hand-written; compiled beside the generated lane forms.
 *
 * FILTER, FOC and PLANT name the generated filter, controller and motor; HEADER_FOC_LANES and HEADER_PLANT_LANES their
 * headers. The loop is that of simulator.c with the averaged inverter: sense, control, then the motor until the next
 * sample. A run leaves figures, not a record. */
#include HEADER_FOC_LANES
#include HEADER_PLANT_LANES
#include "sensor_noise.h"
#include <math.h>

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define DRIVE JOIN(FOC, _t)
#define CONTROL JOIN(FOC, _lanes_t)
#define PLANT_(name) JOIN(PLANT, JOIN(_lanes_, name))

/* The data that all runs share. Samples are counted from 0; `share` is the speed reference of each sample over its end value. */
typedef struct {
    int steps;
    int substeps;       /* Runge-Kutta steps a sample */
    double h;           /* s, their width */
    double v_dc;        /* V */
    double lost;        /* share of the DC link that a leg loses against its current */
    const double *share;
    int load_from;      /* the load acts from this sample on */
    int start_until;    /* first sample that does not count as start */
    int after_from;     /* from here on errors of a loaded run count as after the load step; of others, the last 50 ms */
    int moving_from;    /* from here on the angle counts */
    int late_from;      /* the last 50 ms */
    double locked_angle; /* rad */
    double wrong_way;    /* share of the speed wanted that a rotor may turn backwards before it has locked */
} fleet_task;

/* A run's own numbers and its figures; row k of an array of `runs` columns at array + k * runs. */
typedef struct {
    int runs;
    const DRIVE *drives;   /* controllers, tuned and reset */
    const double *motor;   /* 6 rows, as the plant wants them */
    const double *theta;   /* rad */
    const double *noise;   /* A rms */
    const double *load;    /* N m */
    const double *speed;   /* rad/s */
    const uint64_t *seed;
    double *figures;       /* FIGURES rows */
    int *flags;            /* FLAGS rows */
} fleet_runs;

enum { START, AFTER, LATE_SQUARE, ANGLE, ANGLE_END, LATE_ANGLE, LATE_SPEED, FIGURES };
enum { STATUS, LOCKED_FROM, FINITE, FLAGS };

static const double ROOT_3 = 1.7320508075688772;
static const double TWO_PI = 6.283185307179586;
#define ROUND_64 6755399441055744.0

/* One group of lanes: its state and what its figures are made of. */
typedef struct {
    CONTROL control;
    lanes_f64 s[6];
    lanes_f64 motor[6];
    lanes_f64 sigma, load, speed;
    lanes_f64 figures[FIGURES];
    int flags[FLAGS][LANES];
    uint32_t key[2][LANES];
    float normal[4][LANES]; /* of two samples: sensor a, b, a, b */
} group;

static void begin(group *g, const fleet_runs *r, int first, int count)
{
    lanes_f64 theta;
    int lane, k;
    for (lane = 0; lane < LANES; lane++) {
        const int b = first + ((lane < count) ? lane : count - 1); /* lanes beyond repeat the last run */
        JOIN(FOC, _lanes_load)(&g->control, lane, &r->drives[b]);
        for (k = 0; k < 6; k++) {
            g->motor[k].of[lane] = r->motor[(size_t)k * r->runs + b];
        }
        theta.of[lane] = r->theta[b];
        g->sigma.of[lane] = r->noise[b];
        g->load.of[lane] = r->load[b];
        g->speed.of[lane] = r->speed[b];
        g->key[0][lane] = (uint32_t)r->seed[b];
        g->key[1][lane] = (uint32_t)(r->seed[b] >> 32);
        for (k = 0; k < FIGURES; k++) {
            g->figures[k].of[lane] = 0.0;
        }
        g->flags[STATUS][lane] = 0;
        g->flags[LOCKED_FROM][lane] = 0;
        g->flags[FINITE][lane] = 1;
    }
    PLANT_(rest)(g->motor, &theta, g->s);
}

static void end(const group *g, const fleet_runs *r, int first, int count)
{
    int lane, k;
    for (lane = 0; lane < count; lane++) {
        for (k = 0; k < FIGURES; k++) {
            r->figures[(size_t)k * r->runs + first + lane] = g->figures[k].of[lane];
        }
        for (k = 0; k < FLAGS; k++) {
            r->flags[(size_t)k * r->runs + first + lane] = g->flags[k][lane];
        }
    }
}

/* Noise of sample k, drawn for two samples at a time. */
static const float *draw(group *g, int k)
{
    if (k % 2 == 0) {
        noise_words words[4];
        philox(g->key[0], g->key[1], (uint32_t)(k / 2), words);
        box_muller(&words[0], g->normal[0], g->normal[1]);
        box_muller(&words[2], g->normal[2], g->normal[3]);
    }
    return g->normal[2 * (k % 2)];
}

/* Two phase currents as the controller gets them. */
static void sense(const lanes_f64 *__restrict i, const lanes_f64 *__restrict sigma, const float *__restrict normal,
                  lanes *__restrict phase)
{
    int lane;
    for (lane = 0; lane < LANES; lane++) {
        const double i_a = i[0].of[lane];
        const double i_b = 0.5 * (ROOT_3 * i[1].of[lane] - i[0].of[lane]);
        phase[0].of[lane] = (float)(i_a + sigma->of[lane] * (double)normal[lane]);
        phase[1].of[lane] = (float)(i_b + sigma->of[lane] * (double)normal[LANES + lane]);
    }
}

static void order(const lanes_f64 *__restrict speed, double share, double v_dc, lanes *__restrict command)
{
    int lane;
    for (lane = 0; lane < LANES; lane++) {
        command[0].of[lane] = (float)(speed->of[lane] * share);
        command[1].of[lane] = (float)v_dc;
    }
}

/* Legs less what they lose against their currents. */
static void lose(const lanes *__restrict duty, const lanes_f64 *__restrict i, double lost, lanes_f64 *__restrict leg)
{
    int lane, k;
    for (lane = 0; lane < LANES; lane++) {
        const double a = i[0].of[lane], b = 0.5 * (ROOT_3 * i[1].of[lane] - i[0].of[lane]);
        const double phase[3] = {a, b, -a - b};
        for (k = 0; k < 3; k++) {
            const int sign = ((phase[k] > 0.0) ? 1 : 0) - ((phase[k] < 0.0) ? 1 : 0);
            leg[k].of[lane] = (double)duty[k].of[lane] - lost * sign;
        }
    }
}

static void invert_legs(const lanes_f64 *__restrict leg, double v_dc, lanes_f64 *__restrict v)
{
    int lane;
    for (lane = 0; lane < LANES; lane++) {
        const double a = leg[0].of[lane], b = leg[1].of[lane], c = leg[2].of[lane];
        v[0].of[lane] = v_dc * (2.0 * a - b - c) / 3.0;
        v[1].of[lane] = v_dc * (b - c) / ROOT_3;
    }
}

/* The averaged inverter. */
static void invert(const lanes *__restrict duty, double v_dc, lanes_f64 *__restrict v)
{
    int lane;
    for (lane = 0; lane < LANES; lane++) {
        const double a = (double)duty[0].of[lane], b = (double)duty[1].of[lane], c = (double)duty[2].of[lane];
        v[0].of[lane] = v_dc * (2.0 * a - b - c) / 3.0;
        v[1].of[lane] = v_dc * (b - c) / ROOT_3;
    }
}

/* Inverter and motor until the next sample; what is lost is looked at anew in every Runge-Kutta step. */
static void actuate(group *g, const fleet_task *t, const lanes *duty, const lanes_f64 *load)
{
    lanes_f64 i[2], torque[1], leg[3], v[2];
    int n;
    if (t->lost <= 0.0) {
        invert(duty, t->v_dc, v);
        PLANT_(advance)(g->s, g->motor, v, load, t->h, t->substeps);
        return;
    }
    for (n = 0; n < t->substeps; n++) {
        PLANT_(outputs)(g->s, g->motor, i, torque);
        lose(duty, i, t->lost, leg);
        invert_legs(leg, t->v_dc, v);
        PLANT_(advance)(g->s, g->motor, v, load, t->h, 1);
    }
}

/* Errors of the estimate at sample k; keeps when the lock was last broken, status and finiteness. */
static void judge(group *__restrict g, const fleet_task *__restrict t, int k, lanes_f64 *__restrict speed_error,
                  lanes_f64 *__restrict angle_error)
{
    int lane;
    for (lane = 0; lane < LANES; lane++) {
        const double omega = (double)g->control.filter.x[2].of[lane];
        const double theta = (double)g->control.filter.x[3].of[lane];
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
        g->flags[STATUS][lane] |= g->control.status[lane];
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

/* Runs first .. first + count - 1, from rest to the end. */
void fleet_run(const fleet_task *t, const fleet_runs *r, int first, int count)
{
    static const lanes_f64 NO_LOAD = {{0.0}};
    group g;
    int from, k;
    for (from = first; from < first + count; from += LANES) {
        const int left = first + count - from;
        const int here = (left < LANES) ? left : LANES;
        begin(&g, r, from, here);
        for (k = 0; k < t->steps; k++) {
            lanes_f64 i[2], torque[1];
            lanes phase[2], command[2], duty[3];
            PLANT_(outputs)(g.s, g.motor, i, torque);
            sense(i, &g.sigma, draw(&g, k), phase);
            order(&g.speed, t->share[k], t->v_dc, command);
            JOIN(FOC, _lanes_step)(&g.control, phase, command, duty);
            judge_sample(&g, t, k);
            actuate(&g, t, duty, (k >= t->load_from) ? &g.load : &NO_LOAD);
        }
        end(&g, r, from, here);
    }
}

/* The standard normals that runs of these seeds get: [steps][2][count], count at most LANES. */
void fleet_noise(const uint64_t *seed, int count, int steps, float *normal)
{
    group g;
    int lane, k;
    for (lane = 0; lane < LANES; lane++) {
        const uint64_t s = seed[(lane < count) ? lane : count - 1];
        g.key[0][lane] = (uint32_t)s;
        g.key[1][lane] = (uint32_t)(s >> 32);
    }
    for (k = 0; k < steps; k++) {
        const float *drawn = draw(&g, k);
        for (lane = 0; lane < count; lane++) {
            normal[((size_t)2 * k) * count + lane] = drawn[lane];
            normal[((size_t)2 * k + 1) * count + lane] = drawn[LANES + lane];
        }
    }
}

/* Philox's words of one key and counter, for its known-answer test. */
void fleet_philox(uint64_t key, uint32_t pair, uint32_t words[4])
{
    uint32_t low[LANES], high[LANES];
    noise_words drawn[4];
    int lane, k;
    for (lane = 0; lane < LANES; lane++) {
        low[lane] = (uint32_t)key;
        high[lane] = (uint32_t)(key >> 32);
    }
    philox(low, high, pair, drawn);
    for (k = 0; k < 4; k++) {
        words[k] = drawn[k].of[LANES - 1];
    }
}

/* Drives as the firmware begins: gains and tuning of the drive file. */
void fleet_init(DRIVE *drives, int count)
{
    int b;
    for (b = 0; b < count; b++) {
        JOIN(FOC, _init)(&drives[b], 0);
    }
}

/* After tuning: filters at their x_0 and P_0. */
void fleet_reset(DRIVE *drives, int count)
{
    int b;
    for (b = 0; b < count; b++) {
        JOIN(FILTER, _reset)(&drives[b].filter);
    }
}

int fleet_lanes(void)
{
    return LANES;
}
