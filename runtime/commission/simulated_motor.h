/* simulated_motor.h: a motor behind a switching inverter with dead time, and its current sensors. Hand-written. */
#ifndef SIMULATED_MOTOR_H
#define SIMULATED_MOTOR_H

typedef struct {
    /* the motor: ohm, H, Wb, kg m^2, N m s/rad, N m */
    double R, L_d, L_q, psi_m, pole_pairs, J, D, dry;
    /* the inverter: V, s, s, V of a switch that conducts */
    double dc_link, T, dead_time, drop;
    /* the sensors: A; bits of the converter; offsets of phases a and b */
    double range, bits, noise, offset_a, offset_b;
    /* state: A in the rotor's frame, mechanical rad/s, electrical rad */
    double i_d, i_q, omega, theta;
    double h_max;   /* s */
    int open;       /* gates off, and the currents have died out */
    double largest; /* A: of a phase, so far */
    double fastest; /* rad/s, mechanical, so far */
    unsigned long long random;
} motor_t;

void motor_init(motor_t *m, unsigned long long seed);

/* Currents of phases a and b as the converters show them. */
void motor_sense(motor_t *m, float phase[2]);

/* One sample: a carrier period with these duty cycles, or all switches off. */
void motor_switch(motor_t *m, const float duty[3]);
void motor_freewheel(motor_t *m);

#endif
