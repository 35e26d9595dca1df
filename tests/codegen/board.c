/* board.c: a board for the example interrupt, with filters whose estimate and status the test says beforehand.
 *
 * Hand-written. The text before this one includes the example; in it, in the supervisor and in the drive, the step and
 * the self-tests have other names: scripted_step and so on. What the interrupt does to the hardware is kept. RIVAL is
 * where the second filter is, if there is one. */
#include <string.h>

typedef struct {
    /* what the interrupt will find */
    float phase[2];      /* A */
    float reference;     /* rad/s */
    float link;          /* V */
    int status;          /* of the step */
    int moves;           /* 1: the step leaves omega and theta below */
    float omega;
    float theta;
    float nis;           /* what the step leaves, and the rival's */
    float rival_nis;
    float load;          /* N m, likewise, where it is a state */
    float rival_load;
    float duty_wanted[3];
    float v_wanted[2];   /* V */
    int selftest[2];     /* codes of the filter's and of the controller's self-test */
    /* what it did */
    char events[64];     /* a letter each, in order */
    float duty[3];
    float words[8];
    int word_count;
    float x[N];          /* as the step found it */
    float covariance[N_WORDS];
    float tuning;        /* its R[0] */
    float found_nis;
    float rival_x[N];    /* the same of the rival */
    float rival_covariance[N_WORDS];
    float rival_tuning;
    float rival_found_nis;
    float rival_u[2];
    float u[2];          /* V, WHOLE_CONTROLLER 0: what the step was given */
    float y[2];          /* A, or the phases */
    float command[2];
    float gain_max;      /* A: the controller's maximum current as the step found it */
    float integrator[4];
    float v_acting[2];
    float v_queued[2];
    int delay;
    float loop[4];       /* WHOLE_CONTROLLER 0: i_alpha, i_beta, speed, angle in turns, as the current loop got them */
    float share;         /* of the largest current */
    int anew;
    float svgen[3];      /* v_alpha, v_beta, DC link */
    float tolerance[2];  /* as the self-tests got it */
} board_t;

board_t board;
int states(void);

int states(void)
{
    return N;
}

static void event(char letter)
{
    const size_t length = strlen(board.events);
    if (length + 1 < sizeof board.events) {
        board.events[length] = letter;
        board.events[length + 1] = 0;
    }
}

void read_phase_currents(float32 phase[2])
{
    event('p');
    memcpy(phase, board.phase, sizeof board.phase);
}

float32 read_dc_link(void)
{
    return board.link;
}

float32 read_speed_reference(void)
{
    return board.reference;
}

void write_duty(const float32 duty[3])
{
    event('w');
    memcpy(board.duty, duty, sizeof board.duty);
}

void acknowledge_interrupt(void)
{
    event('a');
}

void inverter_off(void)
{
    event('0');
}

void inverter_on(void)
{
    event('1');
}

void telemetry(const float32 *words, int count)
{
    event('t');
    board.word_count = count;
    memcpy(board.words, words, sizeof(float) * (size_t)count);
}

void your_current_loop(const float32 i[2], float32 speed, float32 theta_pu, float32 share, int anew, float32 v[2])
{
    event('l');
    board.loop[0] = i[0];
    board.loop[1] = i[1];
    board.loop[2] = speed;
    board.loop[3] = theta_pu;
    board.share = share;
    board.anew = anew;
    memcpy(v, board.v_wanted, sizeof board.v_wanted);
}

void your_svgen(const float32 v[2], float32 dc_link, float32 duty[3])
{
    event('v');
    board.svgen[0] = v[0];
    board.svgen[1] = v[1];
    board.svgen[2] = dc_link;
    memcpy(duty, board.duty_wanted, sizeof board.duty_wanted);
}

/* The filters. The rival keeps its place, so that a test can tell the two apart. */
int scripted_step(FILTER_T *f, const float32 u[2], const float32 y[2])
{
#ifdef RIVAL
    if (f == &RIVAL) {
        event('r');
        memcpy(board.rival_x, f->x, sizeof board.rival_x);
        memcpy(board.rival_covariance, f->COVARIANCE, sizeof board.rival_covariance);
        memcpy(board.rival_u, u, sizeof board.rival_u);
        board.rival_tuning = f->R[0];
        board.rival_found_nis = f->nis;
        f->nis = board.rival_nis;
        SET_LOAD(f, board.rival_load);
        return 0;
    }
#endif
    event('s');
    board.tuning = f->R[0];
    memcpy(board.x, f->x, sizeof board.x);
    memcpy(board.covariance, f->COVARIANCE, sizeof board.covariance);
    memcpy(board.u, u, sizeof board.u);
    memcpy(board.y, y, sizeof board.y);
    if (board.moves) {
        f->x[2] = board.omega;
        f->x[3] = board.theta;
    }
    board.found_nis = f->nis;
    f->nis = board.nis;
    SET_LOAD(f, board.load);
    return board.status;
}

int scripted_foc_step(FOC_T *c, const float32 phase[2], const float32 command[2], float32 duty[3])
{
    static const float32 none[2] = {0.0f, 0.0f};
    (void)scripted_step(&c->filter, none, phase);
    memcpy(board.command, command, sizeof board.command);
    board.gain_max = c->gain[MAX_CURRENT_PLACE];
    memcpy(board.integrator, c->integrator, sizeof board.integrator);
    memcpy(board.v_acting, c->v_acting, sizeof board.v_acting);
    memcpy(board.v_queued, c->v_queued, sizeof board.v_queued);
    board.delay = c->delay;
    memcpy(c->command_held, command, sizeof c->command_held);
    c->integrator[0] = c->integrator[1] = c->integrator[2] = c->integrator[3] = 7.0f; /* so that what is not cleared is seen */
    c->v_acting[0] = c->v_acting[1] = c->v_queued[0] = c->v_queued[1] = 7.0f;
    memcpy(duty, board.duty_wanted, sizeof board.duty_wanted);
    return board.status;
}

/* An integer that the supervisor keeps, by its name; NULL if it has none of that name. */
int *field(const char *name)
{
    static const struct {
        const char *name;
        int *place;
    } fields[] = {FIELDS};
    size_t k;
    for (k = 0; k < sizeof fields / sizeof fields[0]; k++) {
        if (strcmp(fields[k].name, name) == 0) {
            return fields[k].place;
        }
    }
    return NULL;
}

int *interrupts_since_telemetry(void)
{
    return &ticks;
}

/* R[0] of the filter, as live tuning sets it. */
void tune(float value)
{
    FILTER.R[0] = value;
}

#if WHOLE_CONTROLLER
/* A: the largest current, likewise. */
float *largest_current(void)
{
    return &drive.control.gain[MAX_CURRENT_PLACE];
}
#endif

/* The self-tests: they leave rubbish in their work space. */
int scripted_selftest(FILTER_T *work, float32 tolerance)
{
    event('f');
    board.tolerance[0] = tolerance;
    memset(work, 0x42, sizeof *work);
    return board.selftest[0];
}

int scripted_foc_selftest(FOC_T *work, float32 tolerance)
{
    event('c');
    board.tolerance[1] = tolerance;
    memset(work, 0x42, sizeof *work);
    return board.selftest[1];
}
