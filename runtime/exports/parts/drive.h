/* Filter, controller and supervisor, as a part. Hand-written. FILTER and DRIVE name them, DC_LINK is in V. */
typedef struct {
    float32 phase[2];   /* A */
    float32 command[2]; /* rad/s mechanical, V */
    int acknowledge;    /* from 0 to 1: leave FAULT */
    int acknowledged;   /* what it was */
    float32 duty[3];    /* 0 .. 1 */
    int gates;          /* 1: enabled */
    int delay;          /* samples from measuring to acting: 0 or 1 */
    JOIN(DRIVE, _t) drive;
} part_t;

static void part_init(part_t *p)
{
    int k;
    memset(p, 0, sizeof *p);
    p->delay = 1;
    JOIN(DRIVE, _init)(&p->drive, p->delay);
    p->command[1] = DC_LINK;
    for (k = 0; k < 3; k++) {
        p->duty[k] = 0.5f;
    }
}

/* Tuning, gains and delay are set. The time to the middle of the interval in which the voltage acts goes with the delay,
 * unless it was set, too. */
static void part_begin(part_t *p)
{
    JOIN(DRIVE, _t) *drive = &p->drive;
    if (p->delay != drive->control.delay) {
        static JOIN(DRIVE, _t) fresh;
        float32 before;
        JOIN(DRIVE, _init)(&fresh, drive->control.delay);
        before = fresh.control.gain[ADVANCE];
        JOIN(DRIVE, _init)(&fresh, p->delay);
        if (drive->control.gain[ADVANCE] == before) {
            drive->control.gain[ADVANCE] = fresh.control.gain[ADVANCE];
        }
        drive->control.delay = fresh.control.delay;
    }
    JOIN(FILTER, _reset)(&drive->control.filter);
}

static void part_step(part_t *p)
{
    if (p->acknowledge != 0 && p->acknowledged == 0) {
        p->drive.supervisor.acknowledged = 1;
    }
    p->acknowledged = p->acknowledge;
    p->gates = JOIN(DRIVE, _step)(&p->drive, p->phase, p->command, p->duty);
}
