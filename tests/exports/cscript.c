/* cscript.c: PLECS' side in a test. EXPORTED is the header; START, OUTPUT and UPDATE include the texts of its sections. */
static const double *row_in;
static double *row_out;
static int first_in[16], first_out[16];
#define InputSignal(port, k) row_in[first_in[port] + (int)(k)]
#define OutputSignal(port, k) row_out[first_out[port] + (int)(k)]
#include EXPORTED

static void start(void)
{
#include "start.inc"
}

static void output(void)
{
#include "output.inc"
}

static void update(void)
{
#include "update.inc"
}

int run(int steps, const double *in, double *out, const char *name, double value)
{
    int k, p, ins = 0, outs = 0;
    for (p = 0; p < INPUT_PORTS; p++) {
        first_in[p] = ins;
        ins += (int)INPUTS[p].count;
    }
    for (p = 0; p < OUTPUT_PORTS; p++) {
        first_out[p] = outs;
        outs += (int)OUTPUTS[p].count;
    }
    start();
    if (name[0]) {
        block_power_up();
        if (!block_set(name, value)) {
            return 1;
        }
        block_begin();
    }
    for (k = 0; k < steps; k++) {
        row_in = in + ins * k;
        row_out = out + outs * k;
        output();
        output();
        update();
    }
    return 0;
}
