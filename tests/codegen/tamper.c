/* tamper.c: the real step, of which one word, the status or the iterations of one sample are changed on the way out.
 *
 * Hand-written. The self-test's file is compiled with the step's name defined to be tampered_step. */
#include <string.h>

typedef struct {
    int calls;
    int sample;    /* which call is tampered with, from 0; -1: none */
    int word;      /* of what the self-test compares; -1: none */
    int bits;      /* of the status, turned over */
    int passes;    /* added to the iterations */
    float value;   /* what the word becomes */
    float input[64][4];
    float x[64][N];            /* as the step found it */
    float covariance[64][N_COVARIANCE];
} tamper_t;

tamper_t tamper;

#if CONTROLLER
int tampered_step(SUBJECT_T *c, const float32 phase[2], const float32 command[2], float32 duty[3])
{
    const int k = tamper.calls++ % 64;
    int status;
    memcpy(tamper.input[k], phase, 8);
    memcpy(tamper.input[k] + 2, command, 8);
    status = REAL_STEP(c, phase, command, duty);
    if (k == tamper.sample && tamper.word >= 0) {
        *((tamper.word < 3) ? &duty[tamper.word] : &c->integrator[tamper.word - 3]) = tamper.value;
    }
    return (k == tamper.sample) ? (status ^ tamper.bits) : status;
}
#else
int tampered_step(SUBJECT_T *f, const float32 u[2], const float32 y[2])
{
    const int k = tamper.calls++ % 64;
    int status;
    memcpy(tamper.input[k], u, 8);
    memcpy(tamper.input[k] + 2, y, 8);
    memcpy(tamper.x[k], f->x, sizeof f->x);
    memcpy(tamper.covariance[k], f->COVARIANCE, sizeof f->COVARIANCE);
    status = REAL_STEP(f, u, y);
    if (k == tamper.sample) {
        if (tamper.word >= 0) {
            *((tamper.word < N) ? &f->x[tamper.word] : &f->COVARIANCE[tamper.word - N]) = tamper.value;
        }
        f->iterations += tamper.passes;
        status ^= tamper.bits;
    }
    return status;
}
#endif

static SUBJECT_T work;
static SUBJECT_T fresh;

int run_selftest(float tolerance);
int is_as_init_leaves_it(void);

int run_selftest(float tolerance)
{
    tamper.calls = 0;
    memset(&work, 0x42, sizeof work);
    return SELFTEST(&work, tolerance);
}

int is_as_init_leaves_it(void)
{
    memset(&fresh, 0x42, sizeof fresh);
    INIT(&fresh);
    return memcmp(&work, &fresh, sizeof work) == 0;
}
