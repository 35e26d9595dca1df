/* simulated_motor.c: a motor behind a switching inverter with dead time, and its current sensors. Hand-written, and no
 * equation of it is generated: what commissioning finds is judged by it.
 *
 * The motor in its rotor's frame, by Runge and Kutta's rule. A carrier a sample, legs centred. A leg switches at the
 * edge of its duty cycle, or after the dead time where the current keeps the other diode conducting until then. */
#include "simulated_motor.h"

#include <math.h>

#define PI 3.14159265358979323846
#define STANDSTILL 1e-3 /* rad/s, electrical: below it dry friction fades, so that it has a slope */

typedef struct {
    double i_d, i_q, omega, theta;
} slopes_t;

void motor_init(motor_t *m, unsigned long long seed)
{
    const double L = fmin(m->L_d, m->L_q);
    m->h_max = fmin(m->T / 8.0, 0.2 * L / m->R);
    m->random = seed * 2862933555777941757ULL + 3037000493ULL;
    m->i_d = m->i_q = m->omega = 0.0;
    m->open = 1;
    m->largest = m->fastest = 0.0;
}

/* Uniform in (0, 1): xorshift. */
static double uniform(motor_t *m)
{
    m->random ^= m->random << 13;
    m->random ^= m->random >> 7;
    m->random ^= m->random << 17;
    return ((double)(m->random >> 11) + 0.5) / 9007199254740992.0;
}

static double normal(motor_t *m)
{
    return sqrt(-2.0 * log(uniform(m))) * cos(2.0 * PI * uniform(m));
}

static void phase_currents(const motor_t *m, double phase[3])
{
    int k;
    for (k = 0; k < 3; k++) {
        const double angle = m->theta - 2.0 * PI * k / 3.0;
        phase[k] = m->i_d * cos(angle) - m->i_q * sin(angle);
    }
}

static slopes_t slopes(const motor_t *m, double v_alpha, double v_beta, double i_d, double i_q, double omega,
                       double theta)
{
    const double c = cos(theta), s = sin(theta), w = m->pole_pairs * omega;
    const double torque = 1.5 * m->pole_pairs * (m->psi_m + (m->L_d - m->L_q) * i_d) * i_q;
    const double dry = m->dry * tanh(w / (STANDSTILL * 100.0));
    slopes_t d;
    d.i_d = m->open ? 0.0 : (c * v_alpha + s * v_beta - m->R * i_d + w * m->L_q * i_q) / m->L_d;
    d.i_q = m->open ? 0.0 : (c * v_beta - s * v_alpha - m->R * i_q - w * (m->L_d * i_d + m->psi_m)) / m->L_q;
    d.omega = (torque - m->D * omega - dry) / m->J;
    d.theta = w;
    return d;
}

static void advance(motor_t *m, double v_alpha, double v_beta, double seconds)
{
    const int n = (int)ceil(seconds / m->h_max);
    const double h = (n > 0) ? seconds / n : 0.0;
    int k;
    for (k = 0; k < n; k++) {
        const double d = m->i_d, q = m->i_q, w = m->omega, t = m->theta, g = 0.5 * h;
        const slopes_t a = slopes(m, v_alpha, v_beta, d, q, w, t);
        const slopes_t b = slopes(m, v_alpha, v_beta, d + g * a.i_d, q + g * a.i_q, w + g * a.omega, t + g * a.theta);
        const slopes_t c = slopes(m, v_alpha, v_beta, d + g * b.i_d, q + g * b.i_q, w + g * b.omega, t + g * b.theta);
        const slopes_t e = slopes(m, v_alpha, v_beta, d + h * c.i_d, q + h * c.i_q, w + h * c.omega, t + h * c.theta);
        m->i_d += h / 6.0 * (a.i_d + 2.0 * b.i_d + 2.0 * c.i_d + e.i_d);
        m->i_q += h / 6.0 * (a.i_q + 2.0 * b.i_q + 2.0 * c.i_q + e.i_q);
        m->omega += h / 6.0 * (a.omega + 2.0 * b.omega + 2.0 * c.omega + e.omega);
        m->theta += h / 6.0 * (a.theta + 2.0 * b.theta + 2.0 * c.theta + e.theta);
    }
}

static void note(motor_t *m)
{
    double phase[3];
    int k;
    phase_currents(m, phase);
    for (k = 0; k < 3; k++) {
        m->largest = fmax(m->largest, fabs(phase[k]));
    }
    m->fastest = fmax(m->fastest, fabs(m->omega));
    m->theta = remainder(m->theta, 2.0 * PI);
}

void motor_sense(motor_t *m, float phase[2])
{
    const double step = 2.0 * m->range / pow(2.0, m->bits);
    const double offset[2] = {m->offset_a, m->offset_b};
    double i[3];
    int k;
    phase_currents(m, i);
    for (k = 0; k < 2; k++) {
        const double shown = i[k] + offset[k] + m->noise * normal(m);
        phase[k] = (float)fmax(-m->range, fmin(m->range - step, step * floor(shown / step + 0.5)));
    }
}

/* Legs at 0 or 1, less what a switch or diode drops. */
static void conduct(motor_t *m, const int on[3], double seconds)
{
    double leg[3], phase[3];
    int k;
    if (seconds <= 0.0) {
        return;
    }
    phase_currents(m, phase);
    for (k = 0; k < 3; k++) {
        leg[k] = m->dc_link * on[k] - ((phase[k] > 0.0) ? m->drop : -m->drop);
    }
    advance(m, (2.0 * leg[0] - leg[1] - leg[2]) / 3.0, (leg[1] - leg[2]) / sqrt(3.0), seconds);
    note(m);
}

/* Half a carrier period in which every leg goes from `before` to its opposite, commanded at edge[k] s. */
static void half_period(motor_t *m, const double edge[3], int before)
{
    double due[3], at = 0.0;
    int on[3], commanded[3] = {0, 0, 0}, k, left = 6;
    for (k = 0; k < 3; k++) {
        due[k] = edge[k];
        on[k] = before;
    }
    while (left > 0) {
        int next = 0;
        for (k = 1; k < 3; k++) {
            next = (due[k] < due[next]) ? k : next;
        }
        if (due[next] >= 0.5 * m->T) {
            break;
        }
        conduct(m, on, due[next] - at);
        at = due[next];
        left--;
        if (!commanded[next]) {
            double phase[3];
            phase_currents(m, phase);
            commanded[next] = 1;
            due[next] += ((phase[next] > 0.0) == (before == 0)) ? m->dead_time : 0.0;
        } else {
            on[next] = 1 - before;
            due[next] = m->T;
        }
    }
    conduct(m, on, 0.5 * m->T - at);
}

void motor_switch(motor_t *m, const float duty[3])
{
    double edge[3];
    int k;
    m->open = 0;
    for (k = 0; k < 3; k++) {
        edge[k] = 0.5 * m->T * (1.0 - (double)duty[k]);
    }
    half_period(m, edge, 0);
    for (k = 0; k < 3; k++) {
        edge[k] = 0.5 * m->T * (double)duty[k];
    }
    half_period(m, edge, 1);
}

/* Diodes drive the currents against the DC link; where they end the phases are open. */
void motor_freewheel(motor_t *m)
{
    const int n = (int)ceil(m->T / 1e-6);
    int k;
    for (k = 0; k < n; k++) {
        const double h = m->T / n;
        double phase[3], leg[3];
        if (!m->open) {
            int j;
            phase_currents(m, phase);
            for (j = 0; j < 3; j++) {
                leg[j] = (phase[j] > 0.0) ? 0.0 : m->dc_link;
            }
            if (hypot(m->i_d, m->i_q) <= m->dc_link * h / fmin(m->L_d, m->L_q)) {
                m->open = 1;
                m->i_d = m->i_q = 0.0;
            }
        }
        if (m->open) {
            advance(m, 0.0, 0.0, h * (n - k));
            break;
        }
        advance(m, (2.0 * leg[0] - leg[1] - leg[2]) / 3.0, (leg[1] - leg[2]) / sqrt(3.0), h);
    }
    note(m);
}
