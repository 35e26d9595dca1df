/* The motor behind its inverter and current sensors, as a part. Hand-written; powered_motor.h is what moves it. */
typedef struct {
    float32 duty[3]; /* 0 .. 1 */
    int gates;       /* 1: enabled; 0: a current dies out through the diodes */
    double dc_link;  /* V */
    double load;     /* N m */
    float32 phase[2]; /* A, as the sensors say */
    double i[2];      /* A, true */
    double torque[1]; /* N m */
    double data[6];   /* R, L_d, L_q, psi_m, J, D */
    double start[2];  /* rad/s mechanical, rad electrical */
    int bits;         /* of the converter; 0: as fine as float32 */
    simulator m;
} part_t;

/* What the data say now: they may change while the motor runs. */
static void take_data(part_t *p)
{
    p->m.motor[0] = p->data[0];
    p->m.motor[1] = 1.0 / p->data[1];
    p->m.motor[2] = 1.0 / (SALIENT ? p->data[2] : p->data[1]);
    p->m.motor[3] = p->data[3];
    p->m.motor[4] = 1.0 / p->data[4];
    p->m.motor[5] = p->data[5];
    p->m.v_dc = p->dc_link;
    p->m.step = (p->bits > 0) ? ldexp(2.0 * p->m.range, -p->bits) : 0.0;
}

static void look(part_t *p)
{
    static const double NONE[2] = {0.0, 0.0};
    JOIN(PLANT, _outputs)(p->m.s, p->m.motor, p->i, p->torque);
    simulator_sense(&p->m, NONE, p->phase);
}

static void part_begin(part_t *p)
{
    take_data(p);
    JOIN(PLANT, _rest)(p->m.motor, p->start[1], p->m.s);
    p->m.s[2] = p->start[0];
    p->m.open = 1;
    look(p);
}

static void part_init(part_t *p)
{
    static const double DATA[6] = MOTOR_DATA;
    int k;
    memset(p, 0, sizeof *p);
    for (k = 0; k < 6; k++) {
        p->data[k] = DATA[k];
    }
    for (k = 0; k < 3; k++) {
        p->duty[k] = 0.5f;
        p->m.duty_next[k] = 0.5;
    }
    p->dc_link = DC_LINK;
    p->m.T = SAMPLE_TIME;
    p->m.dead_time = DEAD_TIME;
    p->m.drop = SWITCH_DROP;
    p->m.range = SENSOR_RANGE;
    p->m.h_max = LONGEST_STEP;
    p->m.delay = INVERTER_DELAY;
    p->m.pole_pairs = POLE_PAIRS_OF_MOTOR;
    part_begin(p);
}

static void part_step(part_t *p)
{
    take_data(p);
    if (p->gates != 0) {
        p->m.open = 0;
        simulator_actuate(&p->m, p->duty, p->load);
    } else {
        int k;
        for (k = 0; k < 3; k++) {
            p->m.duty_next[k] = (double)p->duty[k];
        }
        simulator_freewheel(&p->m, p->load);
    }
    look(p);
}
