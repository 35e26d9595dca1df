/* loop.c: the generated example interrupt in the closed loop, with faults. Hand-written.
 *
 * simulator.h is simulator.c, with inverter, motor and sensors. example_isr.h is the example of the generated folder, as an
 * application would have it; its hardware functions are the simulated ones below. A fault is a row of numbers a sample;
 * samples without one take none of its branches. */
#include "simulator.h"

#define TELEMETRY_EVERY 1 /* the status of every step */
#include "example_isr.h"

enum { REPLACE_A = 1, REPLACE_B = 2, HOLD_A = 4, HOLD_B = 8, CLIP = 16, POWER_OFF = 32, SWAP = 64, OPEN_A = 128, STALL = 256 };

/* The faults of one sample. Sensors: reading = gain * current + offset, then clipped at +-range, then held or
 * replaced; both swapped. The inverter has `link` volts, the controller is told `told`. Phase a may be open, the rotor
 * held, and a load added. */
typedef struct {
    int what;
    int reserved;
    float phase[2];   /* A, instead of what the sensors say */
    double gain[2];
    double offset[2]; /* A */
    double range;     /* A */
    double link;      /* V */
    double told;      /* V */
    double load;      /* N m, beside that of the run */
} fault;

/* A run: arrays of one row a sample. */
typedef struct {
    int steps;
    int states;
    int reacting;         /* 0: the generated controller alone, whatever its status says */
    int fault_from;       /* faults act from this sample on */
    int fault_count;
    const fault *faults;
    const double *noise;  /* 2, A */
    const double *speed;  /* rad/s */
    const double *load;   /* N m */
    double *out;          /* 5: omega, theta, torque, largest phase current (true), DC link as told */
    float *phase;         /* 2, A: as the interrupt read them */
    float *x;             /* the estimate */
    float *duty;          /* 3 */
    int *status;
    int *mode;            /* of the drive, after the interrupt */
    int *reason;          /* why it last gave up its rotor */
} faulty_run;

/* The board. */
static struct {
    simulator *motor;
    const fault *fault; /* of this sample, or none */
    const double *noise;
    double reference;
    double v_dc;        /* V, without a fault */
    float seen[2];
    float duty[3];
    int status;
    int gates;          /* 1: enabled */
} board;

void read_phase_currents(float32 phase[2])
{
    float read[2];
    int k;
    simulator_sense(board.motor, board.noise, read);
    if (board.fault) {
        const fault *f = board.fault;
        for (k = 0; k < 2; k++) {
            read[k] = (float)(f->gain[k] * (double)read[k] + f->offset[k]);
            if (f->what & CLIP) {
                read[k] = (float)fmax(-f->range, fmin(f->range, (double)read[k]));
            }
            if (f->what & (HOLD_A << k)) {
                read[k] = board.seen[k];
            }
            if (f->what & (REPLACE_A << k)) {
                read[k] = f->phase[k];
            }
        }
        if (f->what & SWAP) {
            const float kept = read[0];
            read[0] = read[1];
            read[1] = kept;
        }
    }
    for (k = 0; k < 2; k++) {
        phase[k] = read[k];
        board.seen[k] = read[k];
    }
}

float32 read_dc_link(void)
{
    return (float)(board.fault ? board.fault->told : board.v_dc);
}

float32 read_speed_reference(void)
{
    return (float)board.reference;
}

void write_duty(const float32 duty[3])
{
    int k;
    for (k = 0; k < 3; k++) {
        board.duty[k] = duty[k];
    }
}

void acknowledge_interrupt(void)
{
}

void inverter_off(void)
{
    board.gates = 0;
}

void inverter_on(void)
{
    board.gates = 1;
}

void telemetry(const float32 *words, int count)
{
    (void)count;
    board.status = (int)words[3];
}

/* Gates on, phase a open: its current is held at zero by what its terminal floats to, beta has its voltage. */
static void one_phase_open(simulator *m, double load)
{
    const int n = (int)ceil(m->T / 1e-6);
    const double h = m->T / n, per_amp = 0.2 / (h * m->motor[1]); /* V/A: a large resistance */
    const double v_beta = m->v_dc * ((double)m->duty_next[1] - (double)m->duty_next[2]) / ROOT_3;
    int k;
    for (k = 0; k < n; k++) {
        const double middle = m->s[3] + 0.5 * h * m->pole_pairs * m->s[2];
        double v[2], i[2], torque[1];
        JOIN(PLANT, _outputs)(m->s, m->motor, i, torque);
        v[0] = -m->motor[3] * m->pole_pairs * m->s[2] * sin(middle) - per_amp * i[0];
        v[1] = v_beta;
        JOIN(PLANT, _advance)(m->s, m->motor, v, load, h, 1);
    }
    for (k = 0; k < 3; k++) {
        m->duty_next[k] = (double)board.duty[k];
    }
}

/* The interval until the next sample. */
static void act(simulator *m, double load)
{
    const int what = board.fault ? board.fault->what : 0;
    int k;
    m->v_dc = board.fault ? board.fault->link : board.v_dc;
    load += board.fault ? board.fault->load : 0.0;
    if (board.gates) {
        m->open = 0;
        if (what & OPEN_A) {
            one_phase_open(m, load);
        } else {
            simulator_actuate(m, board.duty, load);
        }
        if (what & STALL) {
            m->s[2] = 0.0;
        }
        return;
    }
    for (k = 0; k < 3; k++) {
        m->duty_next[k] = (double)board.duty[k];
    }
    simulator_freewheel(m, load);
    if (what & STALL) {
        m->s[2] = 0.0;
    }
}

static void record(const faulty_run *r, int k)
{
    double i[2], torque[1];
    double *row = r->out + 5 * k;
    int j;
    JOIN(PLANT, _outputs)(board.motor->s, board.motor->motor, i, torque);
    row[0] = board.motor->s[2];
    row[1] = board.motor->s[3];
    row[2] = torque[0];
    row[3] = hypot(i[0], i[1]);
    row[4] = (double)read_dc_link();
    for (j = 0; j < r->states; j++) {
        r->x[r->states * k + j] = drive.control.filter.x[j];
    }
    for (j = 0; j < 2; j++) {
        r->phase[2 * k + j] = board.seen[j];
    }
    for (j = 0; j < 3; j++) {
        r->duty[3 * k + j] = board.duty[j];
    }
    r->status[k] = board.status;
    r->mode[k] = drive.supervisor.mode;
    r->reason[k] = drive.supervisor.reason;
}

/* The interrupt of an application that does not look at the status. */
static void bare_isr(void)
{
    float32 phase[2], command[2], duty[3];
    read_phase_currents(phase);
    command[0] = read_speed_reference();
    command[1] = read_dc_link();
    board.status = JOIN(FOC, _step)(&drive.control, phase, command, duty);
    write_duty(duty);
}

static int power_up(int reacting)
{
    const int failed = motor_setup();
    if (!reacting) {
        static const float32 ZERO[3] = {0.5f, 0.5f, 0.5f};
        drive.supervisor.mode = PMSM_RUNNING;
        write_duty(ZERO);
        inverter_on();
    }
    return failed;
}

/* A run from power-up on. Returns what motor_setup found: 0 is good. */
int faulty_loop(simulator *m, const faulty_run *r)
{
    int k, failed, powered = 1;
    board.motor = m;
    board.v_dc = m->v_dc;
    board.fault = 0;
    m->open = 1;
    failed = power_up(r->reacting);
    for (k = 0; k < r->steps && failed == 0; k++) {
        const int at = k - r->fault_from;
        board.fault = (at >= 0 && at < r->fault_count) ? &r->faults[at] : 0;
        board.noise = r->noise + 2 * k;
        board.reference = r->speed[k];
        if (board.fault && (board.fault->what & POWER_OFF)) {
            powered = 0;
            board.gates = 0;
            board.status = 0;
        } else {
            if (!powered) {
                powered = 1;
                failed = power_up(r->reacting);
            }
            if (r->reacting) {
                adc_isr();
            } else {
                bare_isr();
            }
        }
        record(r, k);
        act(m, r->load[k]);
    }
    return failed;
}
