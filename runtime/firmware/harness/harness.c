/* harness.c: replays a recording through one generated step function and reports, for each step, a checksum over
 * everything the step left behind. Hand-written and the same on every processor; the generated file beside it is
 * compiled unchanged.
 *
 * subject.h (written for each run) names the step function and its struct, lists the struct's fields as runs of
 * words, and holds the recording. port.h of the processor gives the output, the counter and access to tables.
 *
 *   E <ticks> L <ticks>     an empty call, a loop of known length
 *   S <checksum> <ticks>    one line a step
 *   W <word>                with DUMP_STEP: every word after that step, and nothing else
 */
#include "port.h"
#include "subject.h"

typedef union {
    float real;
    uint32_t bits;
} real_or_bits;

static subject_t subject;
static float32 output[OUTPUTS + 1];

/* The word at `index` of the struct, counted over the runs of subject.h; *run tells which it belongs to. */
static void *field_at(uint16_t index, uint8_t *run)
{
    for (*run = 0; index >= layout[*run].count; (*run)++) {
        index -= layout[*run].count;
    }
    return (char *)&subject + layout[*run].offset + index * layout[*run].size;
}

/* A float's bits. IEEE 754 leaves open which NaN an operation makes, so all count as one. */
static uint32_t bits_of(float32 value)
{
    real_or_bits word;
    word.real = value;
    return (word.bits & 0x7fffffffUL) > 0x7f800000UL ? 0x7fc00000UL : word.bits;
}

/* An integer of the processor's width, as 32 bits. */
static uint32_t integer(const void *field, uint16_t size)
{
    return (uint32_t)(size == 2 ? *(const int16_t *)field : *(const int32_t *)field);
}

/* Status, the step's outputs, then every word of the struct. */
static void observe(int status, uint32_t words[WORDS])
{
    uint16_t k, n = 0;
    words[n++] = (uint32_t)(int32_t)status;
    for (k = 0; k < OUTPUTS; k++) {
        words[n++] = bits_of(output[k]);
    }
    for (k = 0; n < WORDS; k++) {
        uint8_t run;
        const void *field = field_at(k, &run);
        words[n++] = layout[run].is_int ? integer(field, layout[run].size) : bits_of(*(const float32 *)field);
    }
}

/* A segment of the recording: init, then fields set to recorded words, then the filter's reset.
 * In the table: first step, init's option, number of fields, then index and word of each. */
static uint16_t start_segment(uint16_t at)
{
    const uint32_t option = READ(segments[at + 1]);
    uint32_t left = READ(segments[at + 2]);
    (void)option;
    SUBJECT_INIT((int)option);
    at += 3;
    for (; left > 0; left--, at += 2) {
        uint8_t run;
        void *field = field_at((uint16_t)READ(segments[at]), &run);
        real_or_bits word;
        word.bits = READ(segments[at + 1]);
        if (!layout[run].is_int) {
            *(float32 *)field = word.real;
        } else if (layout[run].size == 2) {
            *(int16_t *)field = (int16_t)word.bits;
        } else {
            *(int32_t *)field = (int32_t)word.bits;
        }
    }
    SUBJECT_RESET();
    return at;
}

static void read_inputs(uint16_t step, float32 input[INPUTS])
{
    uint8_t k;
    for (k = 0; k < INPUTS; k++) {
        real_or_bits word;
        word.bits = READ(inputs[(uint16_t)(step * INPUTS + k)]);
        input[k] = word.real;
    }
}

/* The step and a function that does nothing are called by the same instructions, so their counts differ by the step
 * alone: hence neither inlined nor cloned. */
static int nothing PARAMETERS
{
    return 0;
}

__attribute__((noinline, noclone)) static uint32_t timed_step(step_function *step, float32 input[INPUTS], int *status)
{
    const uint32_t before = port_ticks();
    *status = step ARGUMENTS;
    return port_elapsed(before, port_ticks());
}

#ifdef HARNESS_HOST

/* The host keeps every word of every step. */
void harness_run(uint32_t *words)
{
    uint16_t step, at = 0;
    float32 input[INPUTS];
    int status;
    (void)nothing;
    for (step = 0; step < STEPS; step++, words += WORDS) {
        if (at < SEGMENT_WORDS && READ(segments[at]) == step) {
            at = start_segment(at);
        }
        read_inputs(step, input);
        (void)timed_step(&SUBJECT_STEP, input, &status);
        observe(status, words);
    }
}

#else

static uint32_t crc_table[16]; /* of the nibbles, CRC-32 as in zlib */

static void make_crc_table(void)
{
    uint8_t k, bit;
    for (k = 0; k < 16; k++) {
        uint32_t value = k;
        for (bit = 0; bit < 4; bit++) {
            value = (value & 1) ? (value >> 1) ^ 0xedb88320UL : value >> 1;
        }
        crc_table[k] = value;
    }
}

static uint32_t checksum(const uint32_t words[WORDS])
{
    uint32_t crc = 0xffffffffUL;
    uint16_t k;
    uint8_t nibble;
    for (k = 0; k < WORDS; k++) {
        uint32_t word = words[k];
        for (nibble = 0; nibble < 8; nibble++, word >>= 4) {
            crc = crc_table[(crc ^ word) & 0xf] ^ (crc >> 4);
        }
    }
    return crc ^ 0xffffffffUL;
}

static char *hex(char *at, uint32_t word)
{
    int8_t shift;
    for (shift = 28; shift >= 0; shift -= 4) {
        *at++ = "0123456789abcdef"[(word >> shift) & 0xf];
    }
    return at;
}

static void line(char tag, uint32_t first, const uint32_t *second)
{
    char text[24], *at = text;
    *at++ = tag;
    *at++ = ' ';
    at = hex(at, first);
    if (second != 0) {
        *at++ = ' ';
        at = hex(at, *second);
    }
    *at++ = '\n';
    *at = '\0';
    port_print(text);
}

static void calibrate(void)
{
    float32 input[INPUTS] = {0};
    int status;
    const uint32_t empty = timed_step(&nothing, input, &status);
    line('E', empty, 0);
    line('L', port_known_loop(), 0);
}

int main(void)
{
    static uint32_t words[WORDS];
    float32 input[INPUTS];
    uint16_t step, at = 0;
    port_start();
    make_crc_table();
    calibrate();
    for (step = 0; step < STEPS; step++) {
        uint32_t ticks;
        int status;
        if (at < SEGMENT_WORDS && READ(segments[at]) == step) {
            at = start_segment(at);
        }
        read_inputs(step, input);
        ticks = timed_step(&SUBJECT_STEP, input, &status);
        observe(status, words);
#ifdef DUMP_STEP
        if (step == DUMP_STEP) {
            uint16_t k;
            for (k = 0; k < WORDS; k++) {
                line('W', words[k], 0);
            }
            break;
        }
#else
        line('S', checksum(words), &ticks);
#endif
    }
    port_stop();
    return 0;
}

#endif
