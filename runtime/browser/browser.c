/* browser.c: the generated filter as a WebAssembly module. Hand-written; compiled beside the generated .c, which stays
 * untouched. FILTER names it (as in FILTER_t, FILTER_step), HEADER its header. */
#include HEADER

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define EXPORT(name) __attribute__((export_name(#name)))

static JOIN(FILTER, _t) filter;
static JOIN(FILTER, _t) ahead;
static float32 inputs[4]; /* u V, then y A */

EXPORT(start) void start(void)
{
    JOIN(FILTER, _init)(&filter);
}

EXPORT(place_of_inputs) float32 *place_of_inputs(void)
{
    return inputs;
}

EXPORT(place_of_x) float32 *place_of_x(void)
{
    return filter.x;
}

EXPORT(place_of_prediction) float32 *place_of_prediction(void)
{
    return ahead.x;
}

/* One step; before it a copy of the filter predicts alone, which is what a step without a measurement does. */
EXPORT(step) int step(void)
{
    float32 nothing[2];
    nothing[0] = __builtin_nanf("");
    nothing[1] = nothing[0];
    ahead = filter;
    (void)JOIN(FILTER, _step)(&ahead, inputs, nothing);
    return JOIN(FILTER, _step)(&filter, inputs, &inputs[2]);
}
