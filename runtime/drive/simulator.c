/* simulator.c: a sensorless drive on the host. Hand-written; the motor and the controller it calls are generated.
 *
 * powered_motor.h is the motor behind its inverter and sensors. FOC names the controller (FOC_t, FOC_step) and
 * HEADER_FOC its header; DRIVE and HEADER_DRIVE the drive with its supervisor, where it is wanted. Once a sample: sense,
 * control, then inverter and motor until the next one. The pieces are exported too, so that another controller can take
 * the loop's place. */
#include "powered_motor.h"
#include HEADER_FOC
#ifdef DRIVE
#include HEADER_DRIVE
#endif

#ifdef DRIVE
/* Room that a drive takes, bytes, and a drive that has just been switched on: its controller. */
int simulator_drive_size(void)
{
    return (int)sizeof(JOIN(DRIVE, _t));
}

JOIN(FOC, _t) *simulator_switch_on(void *drive, int delay)
{
    JOIN(DRIVE, _t) *d = (JOIN(DRIVE, _t) *)drive;
    JOIN(DRIVE, _init)(d, delay);
    return &d->control;
}
#endif

/* One interrupt of the controller alone, or of the drive around it. Returns whether the gates are on. */
static int step_of(JOIN(FOC, _t) *c, void *drive, const float phase[2], const float command[2], float duty[3], int *status)
{
#ifdef DRIVE
    if (drive) {
        JOIN(DRIVE, _t) *d = (JOIN(DRIVE, _t) *)drive;
        const int gates = JOIN(DRIVE, _step)(d, phase, command, duty);
        *status = d->status;
        return gates;
    }
#endif
    (void)drive;
    *status = JOIN(FOC, _step)(c, phase, command, duty);
    return 1;
}

/* A whole run. Rows of `out`, one a sample, at the instant of sampling: i_alpha, i_beta (as measured), u_alpha,
 * u_beta (the filter's), omega, theta, torque (true), omega, theta (used by the controller). x: the estimate;
 * words_out: its covariance, copied from the filter's own words at `covariance`. `drive`: the supervised drive whose
 * controller c is, which may have the gates off; or none. */
void simulator_run(simulator *m, JOIN(FOC, _t) *c, void *drive, int steps, int n, const double *noise, const double *speed,
                   const double *load, double *out, float *x, const float *covariance, int words,
                   float *words_out, float *duty_out, int *status)
{
    int k, j, gates;
    for (k = 0; k < steps; k++) {
        float phase[2], command[2], duty[3];
        double i[2], torque[1];
        double *row = out + 7 * k;
        simulator_sense(m, noise + 2 * k, phase);
        JOIN(PLANT, _outputs)(m->s, m->motor, i, torque);
        row[0] = (double)phase[0];
        row[1] = (double)phase[1];
        row[2] = (double)c->v_acting[0];
        row[3] = (double)c->v_acting[1];
        row[4] = m->s[2];
        row[5] = m->s[3];
        row[6] = torque[0];
        command[0] = (float)speed[k];
        command[1] = (float)m->v_dc;
        c->sensed[0] = (float)m->s[2];
        c->sensed[1] = (float)remainder(m->s[3], 6.283185307179586);
        gates = step_of(c, drive, phase, command, duty, &status[k]);
        for (j = 0; j < n; j++) {
            x[n * k + j] = c->filter.x[j];
        }
        for (j = 0; j < words; j++) {
            words_out[words * k + j] = covariance[j];
        }
        for (j = 0; j < 3; j++) {
            duty_out[3 * k + j] = duty[j];
        }
        if (gates) {
            m->open = 0;
            simulator_actuate(m, duty, load[k]);
        } else {
            for (j = 0; j < 3; j++) {
                m->duty_next[j] = (double)duty[j];
            }
            simulator_freewheel(m, load[k]);
        }
    }
}
