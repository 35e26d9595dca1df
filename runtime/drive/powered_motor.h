/* powered_motor.h: a motor, its inverter and its current sensors on the host. Hand-written; the motor is generated.
 *
 * PLANT names the motor (PLANT_advance, PLANT_outputs), HEADER_PLANT its header. Once a sample: simulator_sense (noise,
 * offset, quantisation), then simulator_actuate with duty cycles, or simulator_freewheel with the gates off. */
#ifndef POWERED_MOTOR_H
#define POWERED_MOTOR_H

#include HEADER_PLANT
#include <math.h>

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)

typedef struct {
    double s[6];         /* the motor: electrical states, omega, theta, cos theta, sin theta */
    double motor[6];     /* its data */
    double duty[3];      /* acting in this interval */
    double duty_next[3]; /* with computation delay: acting in the next one */
    double T;            /* s */
    double v_dc;         /* V */
    double dead_time;    /* s */
    double drop;         /* V, of a switch or diode that conducts */
    double min_pulse;    /* s: a shorter pulse is left out */
    double offset[2];    /* A, of the two current sensors */
    double step;         /* A, of one count of the converter; 0: no quantisation */
    double range;        /* A, full scale of the converter */
    double h_max;        /* s, longest Runge-Kutta step */
    int delay;           /* samples: 0 or 1 */
    int switching;       /* 0: averaged inverter, 1: carrier comparison */
    double pole_pairs;
    int open;            /* gates off, and the currents have died out */
} simulator;

static const double ROOT_3 = 1.7320508075688772;

/* Two phase currents as the controller gets them. */
void simulator_sense(const simulator *m, const double noise[2], float phase[2])
{
    double i[2], torque[1], measured[2];
    int k;
    JOIN(PLANT, _outputs)(m->s, m->motor, i, torque);
    measured[0] = i[0];
    measured[1] = 0.5 * (ROOT_3 * i[1] - i[0]);
    for (k = 0; k < 2; k++) {
        double value = measured[k] + noise[k] + m->offset[k];
        if (m->step > 0.0) {
            value = fmax(-m->range, fmin(m->range - m->step, m->step * floor(value / m->step + 0.5)));
        }
        phase[k] = (float)value;
    }
}

static void advance(simulator *m, const double leg[3], double load, double length)
{
    double v[2];
    int n = (int)ceil(length / m->h_max - 1e-9);
    if (length <= 0.0) {
        return;
    }
    n = n < 1 ? 1 : n;
    v[0] = m->v_dc * (2.0 * leg[0] - leg[1] - leg[2]) / 3.0;
    v[1] = m->v_dc * (leg[1] - leg[2]) / ROOT_3;
    JOIN(PLANT, _advance)(m->s, m->motor, v, load, length / n, n);
}

static int sign_of(double value)
{
    return ((value > 0.0) ? 1 : 0) - ((value < 0.0) ? 1 : 0);
}

static void phase_currents(const simulator *m, double phase[3])
{
    double i[2], torque[1];
    JOIN(PLANT, _outputs)(m->s, m->motor, i, torque);
    phase[0] = i[0];
    phase[1] = 0.5 * (ROOT_3 * i[1] - i[0]);
    phase[2] = -phase[0] - phase[1];
}

/* Legs less `lost`, a share of the DC link, against their currents. */
static void conduct(simulator *m, const double leg[3], double lost, double load, double length)
{
    double phase[3], left[3];
    int k;
    if (lost <= 0.0) {
        advance(m, leg, load, length);
        return;
    }
    phase_currents(m, phase);
    for (k = 0; k < 3; k++) {
        left[k] = leg[k] - lost * sign_of(phase[k]);
    }
    advance(m, left, load, length);
}

/* The averaged inverter. What it loses is looked at anew in every Runge-Kutta step: currents pass zero. */
static void averaged(simulator *m, double load)
{
    const double lost = m->dead_time / m->T + m->drop / m->v_dc;
    const int n = (lost > 0.0) ? (int)ceil(m->T / m->h_max - 1e-9) : 1;
    int k;
    for (k = 0; k < n; k++) {
        conduct(m, m->duty, lost, load, m->T / n);
    }
}

/* A pulse too short for the switches is left out, a gap too short is filled. */
static double switched(const simulator *m, double duty)
{
    if (duty * m->T < m->min_pulse) {
        return 0.0;
    }
    return ((1.0 - duty) * m->T < m->min_pulse) ? 1.0 : duty;
}

/* Half a carrier period in which every leg changes state once: at `edge` (s from its start) from `before`. */
static void half_period(simulator *m, const double edge[3], double before, double load)
{
    double leg[3], at = 0.0;
    int done[3], k, left;
    for (k = 0; k < 3; k++) {
        leg[k] = before;
        done[k] = 0;
    }
    for (left = 3; left > 0; left--) {
        int next = -1;
        for (k = 0; k < 3; k++) {
            if (!done[k] && (next < 0 || edge[k] < edge[next])) {
                next = k;
            }
        }
        conduct(m, leg, m->drop / m->v_dc, load, edge[next] - at);
        at = edge[next];
        leg[next] = 1.0 - before;
        done[next] = 1;
    }
    conduct(m, leg, m->drop / m->v_dc, load, 0.5 * m->T - at);
}

/* Dead time: a leg whose current flows out (i > 0) turns on late, one whose current flows in turns off late. */
static void dead_time(const simulator *m, int rising, double edge[3])
{
    double phase[3];
    int k;
    phase_currents(m, phase);
    for (k = 0; k < 3; k++) {
        if ((phase[k] > 0.0) == (rising != 0)) {
            edge[k] = fmin(0.5 * m->T, edge[k] + m->dead_time);
        }
    }
}

/* One sample of inverter and motor with the controller's duty cycles and the load torque in N m. */
void simulator_actuate(simulator *m, const float duty[3], double load)
{
    double edge[3];
    int k;
    for (k = 0; k < 3; k++) {
        m->duty[k] = m->delay ? m->duty_next[k] : (double)duty[k];
        m->duty_next[k] = (double)duty[k];
    }
    if (!m->switching) {
        averaged(m, load);
        return;
    }
    for (k = 0; k < 3; k++) {
        m->duty[k] = switched(m, m->duty[k]);
    }
    for (k = 0; k < 3; k++) {
        edge[k] = 0.5 * m->T * (1.0 - m->duty[k]);
    }
    dead_time(m, 1, edge);
    half_period(m, edge, 0.0, load);
    for (k = 0; k < 3; k++) {
        edge[k] = 0.5 * m->T * m->duty[k];
    }
    dead_time(m, 0, edge);
    half_period(m, edge, 1.0, load);
}

/* Gates off: a current goes on through the diodes against the DC link and dies out; then the phases are open. Holds
 * while the back-EMF between two phases is below the link. */
void simulator_freewheel(simulator *m, double load)
{
    const int n = (int)ceil(m->T / 1e-6);
    const double h = m->T / n;
    int k, j;
    for (k = 0; k < n; k++) {
        const double middle = m->s[3] + 0.5 * h * m->pole_pairs * m->s[2];
        const double emf = m->motor[3] * m->pole_pairs * m->s[2];
        double v[2], i[2], torque[1], rest_state[6];
        v[0] = -emf * sin(middle); /* what keeps a current of zero at zero */
        v[1] = emf * cos(middle);
        if (!m->open) {
            double phase[3], leg[3];
            JOIN(PLANT, _outputs)(m->s, m->motor, i, torque);
            phase[0] = i[0];
            phase[1] = 0.5 * (ROOT_3 * i[1] - i[0]);
            phase[2] = -phase[0] - phase[1];
            for (j = 0; j < 3; j++) {
                leg[j] = (phase[j] > 0.0) ? 0.0 : 1.0;
            }
            v[0] = m->v_dc * (2.0 * leg[0] - leg[1] - leg[2]) / 3.0;
            v[1] = m->v_dc * (leg[1] - leg[2]) / ROOT_3;
            if (hypot(i[0], i[1]) <= m->v_dc * h * m->motor[1]) { /* less than the next step takes away */
                m->open = 1;
            }
        }
        JOIN(PLANT, _advance)(m->s, m->motor, v, load, h, 1);
        if (m->open) {
            JOIN(PLANT, _rest)(m->motor, m->s[3], rest_state);
            m->s[0] = rest_state[0];
            m->s[1] = rest_state[1];
        }
    }
}

#endif
