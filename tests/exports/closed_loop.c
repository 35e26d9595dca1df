/* closed_loop.c: drive and motor from the generated sources themselves, exchanging values once a sample as two FMUs do:
 * duty cycles and gates reach the motor a sample after the currents they answer. */
#include HEADER_DRIVE
#include "powered_motor.h"

/* Rows of out: i_a, i_b, omega, theta, torque after the sample; duty cycles; gates, mode, status. */
void closed_loop(simulator *m, int steps, const double *speed, const double *load, double link, double *out)
{
    static JOIN(DRIVE, _t) drive;
    static const double NONE[2] = {0.0, 0.0};
    float32 duty[3] = {0.5f, 0.5f, 0.5f}, phase[2];
    int k, j, gates = 0;
    JOIN(DRIVE, _init)(&drive, 1);
    m->open = 1;
    simulator_sense(m, NONE, phase);
    for (k = 0; k < steps; k++) {
        const float32 command[2] = {(float32)speed[k], (float32)link};
        float32 next[3] = {duty[0], duty[1], duty[2]};
        double i[2], torque[1];
        double *row = out + 11 * k;
        const int gates_next = JOIN(DRIVE, _step)(&drive, phase, command, next);
        if (gates) {
            m->open = 0;
            simulator_actuate(m, duty, load[k]);
        } else {
            for (j = 0; j < 3; j++) {
                m->duty_next[j] = (double)duty[j];
            }
            simulator_freewheel(m, load[k]);
        }
        simulator_sense(m, NONE, phase);
        JOIN(PLANT, _outputs)(m->s, m->motor, i, torque);
        gates = gates_next;
        row[0] = (double)phase[0];
        row[1] = (double)phase[1];
        row[2] = m->s[2];
        row[3] = m->s[3];
        row[4] = torque[0];
        for (j = 0; j < 3; j++) {
            duty[j] = next[j];
            row[5 + j] = (double)duty[j];
        }
        row[8] = gates;
        row[9] = drive.supervisor.mode;
        row[10] = drive.status;
    }
}
