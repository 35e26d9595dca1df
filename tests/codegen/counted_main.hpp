/* counted_main.hpp: runs a subject and tells what each step executed, and each function at least and at most.
 *
 *   S <mode before it> <counts>              a step
 *   F <address> <least> <most> <least> ...   a function, by count
 */
#include <stdio.h>
#include <string.h>

#undef if
#undef while

long counts[KINDS];

enum { MOST_DEPTH = 64, MOST_FUNCTIONS = 512 };
struct function_t {
    void *address;
    long calls, most[KINDS], least[KINDS];
};
static function_t functions[MOST_FUNCTIONS];
static long before[MOST_DEPTH][KINDS];
static int depth, told, mode;

#define HOOK extern "C" __attribute__((no_instrument_function)) void

HOOK __cyg_profile_func_enter(void *, void *)
{
    counts[CALL]++;
    memcpy(before[depth++], counts, sizeof counts);
}

HOOK __cyg_profile_func_exit(void *address, void *)
{
    const long *entered = before[--depth];
    function_t *f = functions;
    while (f->calls != 0 && f->address != address) {
        f++;
    }
    for (int k = 0; k < KINDS; k++) {
        const long spent = counts[k] - entered[k];
        f->most[k] = (f->calls == 0 || spent > f->most[k]) ? spent : f->most[k];
        f->least[k] = (f->calls == 0 || spent < f->least[k]) ? spent : f->least[k];
    }
    f->address = address;
    f->calls++;
    if (depth == 0 && told) {
        printf("S %d", mode);
        for (int k = 0; k < KINDS; k++) {
            printf(" %ld", counts[k] - entered[k]);
        }
        printf("\n");
    }
}

#define OWN static __attribute__((no_instrument_function))

OWN void set(const int count, int *at)
{
    for (int k = 0; k < count; k++, (*at)++) { /* floats and ints have 32 bits here */
        memcpy((char *)&s + WORDS[*at].place, &WORDS[*at].bits, 4);
    }
}

OWN void report()
{
    for (const function_t *f = functions; f->calls != 0; f++) {
        printf("F %lx", (unsigned long)f->address);
        for (int k = 0; k < KINDS; k++) {
            printf(" %ld %ld", f->least[k], f->most[k]);
        }
        printf("\n");
    }
}

__attribute__((no_instrument_function)) int main()
{
    int at = 0;
    const unsigned *row = INPUTS;
    for (const auto &piece : PIECES) {
        const int option = piece.option;
        (void)option;
        INIT(option);
        set(piece.fields, &at);
        RESET();
        set(piece.later, &at);
        for (int k = 0; k < piece.steps; k++, row += 4) {
            float32 input[4];
            memcpy(input, row, sizeof input);
            mode = MODE;
            told = 1;
            (void)STEP(input);
            told = 0;
        }
    }
    report();
    return 0;
}
