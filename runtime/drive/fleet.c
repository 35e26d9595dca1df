/* fleet.c: closed loops side by side, LANES at a time. Hand-written; compiled beside the generated lane forms.
 *
 * FILTER, FOC and PLANT name the generated filter, controller and motor; HEADER_FOC_LANES and HEADER_PLANT_LANES their
 * headers. Where the drive is supervised, WHOLE names it with its modes and HEADER_WHOLE_LANES its header; HEADER_PLANT is
 * the scalar motor's. The loop is that of simulator.c with the averaged inverter: sense, control, then the motor until the
 * next sample. A run leaves figures, not a record. */
#include HEADER_FOC_LANES
#include HEADER_PLANT_LANES
#include "sensor_noise.h"
#include <math.h>
#ifdef WHOLE
#include HEADER_WHOLE_LANES
#include "powered_motor.h"
#else
static const double ROOT_3 = 1.7320508075688772;
#endif

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#ifdef WHOLE
#define DRIVE JOIN(WHOLE, _t)
#define GROUP(name) JOIN(WHOLE, JOIN(_lanes_, name))
#define FILTER_OF(d) (d)->control.filter
#else
#define DRIVE JOIN(FOC, _t)
#define GROUP(name) JOIN(FOC, JOIN(_lanes_, name))
#define FILTER_OF(d) (d)->filter
#endif
#define PLANT_(name) JOIN(PLANT, JOIN(_lanes_, name))

/* The data that all runs share. Samples are counted from 0; `share` is the speed reference of each sample over its end value. */
typedef struct {
    int steps;
    int substeps;       /* Runge-Kutta steps a sample */
    double h;           /* s, their width */
    double v_dc;        /* V */
    double T;           /* s, a sample */
    double pole_pairs;
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
enum { STATUS, LOCKED_FROM, FINITE, MODE, REASON, FLAGS };

static const double TWO_PI = 6.283185307179586;
#define ROUND_64 6755399441055744.0

/* One group of lanes: its state and what its figures are made of. */
typedef struct {
    GROUP(t) drive;
#ifdef WHOLE
    int open[LANES]; /* gates off, and the currents have died out */
#endif
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
        GROUP(load)(&g->drive, lane, &r->drives[b]);
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
#ifdef WHOLE
        g->open[lane] = 1;
#endif
    }
    PLANT_(rest)(g->motor, &theta, g->s);
}

static void end(group *g, const fleet_runs *r, int first, int count)
{
    int lane, k;
    for (lane = 0; lane < LANES; lane++) {
#ifdef WHOLE
        g->flags[MODE][lane] = g->drive.supervisor.mode[lane];
        g->flags[REASON][lane] = g->drive.supervisor.reason[lane];
#else
        g->flags[MODE][lane] = -1;
        g->flags[REASON][lane] = 0;
#endif
    }
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

#ifdef WHOLE
/* One motor with its gates off: simulator.c's own. */
static void freewheel(const lanes_f64 *s, group *g, const fleet_task *t, double load, int lane)
{
    simulator m;
    int k;
    for (k = 0; k < 6; k++) {
        m.s[k] = s[k].of[lane];
        m.motor[k] = g->motor[k].of[lane];
    }
    m.T = t->T;
    m.v_dc = t->v_dc;
    m.pole_pairs = t->pole_pairs;
    m.open = g->open[lane];
    simulator_freewheel(&m, load);
    g->open[lane] = m.open;
    for (k = 0; k < 6; k++) {
        g->s[k].of[lane] = m.s[k];
    }
}

/* Until the next sample: lanes whose gates are on by their duty cycles, the others through their diodes. */
static void advance_group(group *g, const fleet_task *t, const lanes *duty, const lanes_f64 *load)
{
    lanes_f64 before[6];
    const int *inverter = g->drive.supervisor.inverter;
    int on = 0, lane, k;
    for (lane = 0; lane < LANES; lane++) {
        on += (inverter[lane] != 0) ? 1 : 0;
    }
    for (k = 0; k < 6; k++) {
        before[k] = g->s[k];
    }
    if (on > 0) {
        actuate(g, t, duty, load);
    }
    for (lane = 0; lane < LANES; lane++) {
        if (inverter[lane] != 0) {
            g->open[lane] = 0;
        } else {
            freewheel(before, g, t, load->of[lane], lane);
        }
    }
}
#else
#define advance_group actuate
#endif

#include "fleet_figures.h"

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
            GROUP(step)(&g.drive, phase, command, duty);
            judge_sample(&g, t, k);
            advance_group(&g, t, duty, (k >= t->load_from) ? &g.load : &NO_LOAD);
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
#ifdef WHOLE
        JOIN(WHOLE, _init)(&drives[b], 0);
#else
        JOIN(FOC, _init)(&drives[b], 0);
#endif
    }
}

/* After tuning: filters at their x_0 and P_0. */
void fleet_reset(DRIVE *drives, int count)
{
    int b;
    for (b = 0; b < count; b++) {
        JOIN(FILTER, _reset)(&FILTER_OF(&drives[b]));
    }
}

int fleet_lanes(void)
{
    return LANES;
}
