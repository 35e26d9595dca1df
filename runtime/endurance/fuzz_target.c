/* fuzz_target.c: plays a string of bytes as operations on a generated filter or controller, and judges every step.
 * Hand-written; compiled beside the generated .c, which stays untouched: by clang with libFuzzer and sanitizers
 * (FUZZER defined), and by any compiler to play kept inputs again.
 *
 * FILTER and HEADER name the filter or the controller (CONTROLLER defined), CORE the filter in either case; N_STATES
 * and THETA say how many states there are and which is the angle. WORDS and INTEGERS list the struct's fields, read
 * from its header: WORDS(F, G) calls F(field of the filter) and G(field of the controller) for fields of float32,
 * INTEGERS likewise. With LANES_HEADER the lane form is compared too. */
#include HEADER
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define STATE JOIN(FILTER, _t)
#define CORE_STATE JOIN(CORE, _t)

#ifdef CONTROLLER
#define CORE_OFFSET offsetof(STATE, filter)
#else
#define CORE_OFFSET 0
#endif
#define INPUTS 4 /* v_alpha, v_beta, i_alpha, i_beta; controller: i_a, i_b, speed reference, DC link */
#define PACKED (N_STATES * (N_STATES + 1) / 2)

/* Steps one input may make: enough for a wrong word to travel, few enough for 10^5 inputs a second. */
#define MOST_STEPS 24
/* Passes one step may be asked for: max_iterations is a loop's bound, and no value of it can do more than take long. */
#define MOST_ITERATIONS 12

/* Semantic coverage: which sizes of which words, and which status bits, an input brings about. */
#define CLASSES 9
#define FEATURES ((N_STATES + PACKED) * 2 * CLASSES + 64 + 4)
#ifdef FUZZER
__attribute__((section("__libfuzzer_extra_counters")))
#endif
static uint8_t features[FEATURES];

/* --- the struct's words, by number ---------------------------------------------------------------------------- */

typedef struct {
    size_t at;
    int count;
} field;

#define OF_CORE(name) {CORE_OFFSET + offsetof(CORE_STATE, name), (int)(sizeof(((CORE_STATE *)0)->name) / 4U)},
#define OF_WHOLE(name) {offsetof(STATE, name), (int)(sizeof(((STATE *)0)->name) / 4U)},
static const field words[] = {WORDS(OF_CORE, OF_WHOLE)};
static const field integers[] = {INTEGERS(OF_CORE, OF_WHOLE)};
#define LENGTH(array) (sizeof(array) / sizeof((array)[0]))

/* Place of a field's word; the number counts around. */
static unsigned char *place(STATE *f, const field *fields, size_t length, int number)
{
    int total = 0;
    size_t i;
    for (i = 0; i < length; i++) {
        total += fields[i].count;
    }
    number = number % total;
    for (i = 0; number >= fields[i].count; i++) {
        number -= fields[i].count;
    }
    return (unsigned char *)f + fields[i].at + 4U * (size_t)number;
}

static const float32 special[] = {
    0.0f, -0.0f, 1.0f, -1.0f, 1e-45f, -1e-45f, 1.17549435e-38f, -1.17549435e-38f, 3.40282347e+38f, -3.40282347e+38f,
    1e-18f, 1e-20f, 1e18f, -1e18f, 1e19f, -1e19f, 1e20f, 3.14159274f, -3.14159274f, 3.1415925f, 6.2831855f, 1e3f, 1e6f,
    1.2582912e+07f, -1.2582912e+07f, 2.5165824e+07f, 1e-6f, 1e6f, 8.0f, 0.125f,
};

/* The table's numbers, then infinities and NaNs quiet, signalling and negative. */
static float32 special_value(int index)
{
    static const uint32_t odd[] = {0x7F800000u, 0xFF800000u, 0x7FC00000u, 0x7F800001u, 0xFFC00000u, 0xFFFFFFFFu};
    const int numbers = (int)LENGTH(special);
    float32 value;
    index = index % (numbers + (int)LENGTH(odd));
    if (index < numbers) {
        return special[index];
    }
    memcpy(&value, &odd[index - numbers], 4);
    return value;
}

/* --- bytes as they come, 0 beyond the end ---------------------------------------------------------------------- */

typedef struct {
    const uint8_t *data;
    size_t size;
    size_t at;
} source;

static int take(source *s)
{
    return (s->at < s->size) ? (int)s->data[s->at++] : 0;
}

/* Little-endian, so that a kept input means the same everywhere. */
static float32 take_word(source *s)
{
    uint32_t bits = 0;
    float32 value;
    int k;
    for (k = 0; k < 4; k++) {
        bits |= (uint32_t)take(s) << (8 * k);
    }
    memcpy(&value, &bits, 4);
    return value;
}

#include "fuzz_judge.h"

/* --- one step -------------------------------------------------------------------------------------------------- */

#ifdef LANES_HEADER
#include "fuzz_lanes.h"
#endif

static CORE_STATE *core(STATE *f)
{
#ifdef CONTROLLER
    return &f->filter;
#else
    return f;
#endif
}

static void step(STATE *f, const float32 input[INPUTS], fuzz_verdict *v)
{
    float32 first[2], second[2];
    CORE_STATE before;
    CORE_STATE *c = core(f);
    int most;
    if (c->max_iterations > MOST_ITERATIONS) {
        c->max_iterations = MOST_ITERATIONS;
    }
    before = *c;
    first[0] = input[0];
    first[1] = input[1];
    second[0] = input[2];
    second[1] = input[3];
    v->step++;
#ifdef CONTROLLER
    {
        float32 duty[3];
        int i;
        v->status = JOIN(FILTER, _step)(f, first, second, duty);
        for (i = 0; i < 3; i++) {
            if (!(duty[i] >= 0.0f && duty[i] <= 1.0f)) {
                report(v, DUTY_OUTSIDE, i);
            }
        }
    }
#else
#ifdef LANES_HEADER
    noted[count_noted].before = *f;
    memcpy(noted[count_noted].u, first, sizeof(first));
    memcpy(noted[count_noted].y, second, sizeof(second));
#endif
    v->status = JOIN(FILTER, _step)(f, first, second);
#ifdef LANES_HEADER
    noted[count_noted].after = *f;
    noted[count_noted].status = v->status;
    count_noted = (count_noted < MOST_STEPS + 1) ? count_noted + 1 : 0; /* only what warms up makes more */
#endif
#endif
    feel(c, v->status);
    if ((v->status & PMSM_RESTARTED) == 0) {
        judge_state(c, v);
    }
    if ((v->status & EXCUSES) == 0) {
        judge_covariance(&before, c, v);
    }
    if ((v->status & ~HARMLESS) == 0 && first_not_finite(c) == PACKED) { /* else the next step must say so */
        judge_tuning(&before, v);
    }
    most = (before.max_iterations > 1) ? before.max_iterations : 1;
    if (c->iterations < 0 || c->iterations > most) {
        report(v, ITERATIONS_OUTSIDE, 0);
    }
}

/* A slow rotation well inside the box, the k-th sample of it. */
static void ordinary(int k, float32 input[INPUTS])
{
    static const float32 circle[] = {1.0f, 0.92f, 0.71f, 0.38f, 0.0f, -0.38f, -0.71f, -0.92f, -1.0f, -0.92f, -0.71f,
        -0.38f, 0.0f, 0.38f, 0.71f, 0.92f};
#ifdef CONTROLLER
    input[0] = 2.0f * circle[k & 15];
    input[1] = 2.0f * circle[(k + 11) & 15];
    input[2] = 20.0f;
    input[3] = 300.0f;
#else
    input[0] = 20.0f * circle[k & 15];
    input[1] = 20.0f * circle[(k + 12) & 15];
    input[2] = 2.0f * circle[(k + 1) & 15];
    input[3] = 2.0f * circle[(k + 13) & 15];
#endif
}

static void ordinary_step(STATE *f, fuzz_verdict *v)
{
    float32 input[INPUTS];
    ordinary(v->step, input);
    step(f, input, v);
}

static void start(STATE *f)
{
#ifdef CONTROLLER
    JOIN(FILTER, _init)(f, 0);
#else
    JOIN(FILTER, _init)(f);
#endif
}

/* --- operations: a byte says which, the next ones its operands --------------------------------------------------- */

enum { STEPS, STEP_BITS, STEP_SPECIAL, WORD_BITS, WORD_SPECIAL, WORD_FLIP, WORD_SCALED, OTHER, OPERATIONS };

static void change_word(STATE *f, int operation, source *s)
{
    unsigned char *at = place(f, words, LENGTH(words), take(s));
    float32 value;
    uint32_t bits;
    memcpy(&value, at, 4);
    memcpy(&bits, at, 4);
    if (operation == WORD_BITS) {
        value = take_word(s);
    } else if (operation == WORD_SPECIAL) {
        value = special_value(take(s));
    } else if (operation == WORD_FLIP) {
        bits ^= (uint32_t)1 << (take(s) & 31);
        memcpy(&value, &bits, 4);
    } else { /* times a power of two, to 0 or infinity where it does not fit */
        int power = take(s) - 128;
        for (; power > 0; power--) {
            value = value * 2.0f;
        }
        for (; power < 0; power++) {
            value = value * 0.5f;
        }
    }
    memcpy(at, &value, 4);
}

static void change_other(STATE *f, source *s)
{
    const int what = take(s);
    CORE_STATE *c = core(f);
    int i;
    switch (what & 3) {
    case 0:
        c->max_iterations = ((what >> 2) == 63) ? -32767 : (what >> 2) % (MOST_ITERATIONS + 2) - 1;
        break;
    case 1:
        JOIN(CORE, _reset)(c);
        break;
    case 2: { /* a whole state */
        for (i = 0; i < N_STATES; i++) {
            c->x[i] = take_word(s);
        }
        for (i = 0; i < PACKED; i++) {
            c->LD[i] = take_word(s);
        }
        break;
    }
    default: { /* counters at their ends, switches on */
        static const int values[] = {0, 1, 32767, -32767, 2147483647, -2147483647, 2, -1};
        memcpy(place(f, integers, LENGTH(integers), what >> 5), &values[(what >> 2) & 7], sizeof(int));
        break;
    }
    }
}

static void play(STATE *f, source *s, fuzz_verdict *v)
{
    while (s->at < s->size && v->step < MOST_STEPS && v->kind == GOOD) {
        const int byte = take(s);
        const int operation = byte % OPERATIONS;
        float32 input[INPUTS];
        int k;
        if (operation == STEPS) {
            for (k = 0; k <= byte / OPERATIONS % 8 && v->kind == GOOD; k++) {
                ordinary_step(f, v);
            }
        } else if (operation == STEP_BITS || operation == STEP_SPECIAL) {
            ordinary(v->step, input);
            for (k = 0; k < INPUTS; k++) {
                if (((byte / OPERATIONS) >> k & 1) == 0) {
                    input[k] = (operation == STEP_BITS) ? take_word(s) : special_value(take(s));
                }
            }
            step(f, input, v);
        } else if (operation == OTHER) {
            change_other(f, s);
        } else {
            change_word(f, operation, s);
        }
    }
}

/* Play an input: from the drive's start (first byte even) or from a filter that has run; two ordinary steps follow. */
static void run(const uint8_t *data, size_t size, fuzz_verdict *v)
{
    static STATE f, warm; /* the address sanitizer guards both ends of each */
    static int warmed = 0;
    source s = {data, size, 0};
    int k;
    memset(v, 0, sizeof(*v));
    if (warmed == 0) {
        start(&warm);
        while (v->step < 200) {
            ordinary_step(&warm, v);
        }
        memset(v, 0, sizeof(*v));
        memset(features, 0, sizeof(features));
#ifdef LANES_HEADER
        count_noted = 0;
#endif
        warmed = 1;
    }
    if (take(&s) % 2 == 0) {
        start(&f);
    } else {
        f = warm;
    }
    play(&f, &s, v);
    for (k = 0; k < 2 && v->kind == GOOD; k++) {
        ordinary_step(&f, v);
    }
#ifdef LANES_HEADER
    compare_lanes(v);
#endif
}

/* Play one input and say how it went; with `seen`, mark the features it shows. */
void fuzz_replay(const uint8_t *data, int size, fuzz_verdict *verdict, uint8_t *seen)
{
    int i;
    memset(features, 0, sizeof(features));
    run(data, (size_t)size, verdict);
    for (i = 0; i < FEATURES && seen != NULL; i++) {
        seen[i] = features[i];
    }
}

int fuzz_features(void)
{
    return FEATURES;
}

#ifdef FUZZER
/* The first input of each kind of finding and word is printed; the search goes on. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static uint8_t said[KINDS][64];
    fuzz_verdict v;
    run(data, size, &v);
    if (v.kind != GOOD && said[v.kind][v.word & 63] == 0) {
        size_t i;
        said[v.kind][v.word & 63] = 1;
        fprintf(stderr, "\nFINDING ");
        for (i = 0; i < size; i++) {
            fprintf(stderr, "%02x", data[i]);
        }
        fprintf(stderr, "\n");
    }
    return 0;
}
#endif
