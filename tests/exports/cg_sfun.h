/* cg_sfun.h: the simulator's side in a test: sizes, then a run of `steps` samples with inputs and outputs as rows.
 * mdlOutputs is called `again` times a sample, as in an algebraic loop. Returns 0, or 1 with the error in *error. */
static int width_of(const int *widths, int count)
{
    int k, sum = 0;
    for (k = 0; k < count; k++) {
        sum += widths[k];
    }
    return sum;
}

int sizes(SimStruct *S)
{
    mdlInitializeSizes(S);
    if (!S->error) {
        mdlInitializeSampleTimes(S);
    }
    return S->error ? 1 : 0;
}

int run(SimStruct *S, int steps, const double *in, double *out, int again, int change_at, double *changed, double to)
{
    const int ins = width_of(S->input_width, S->inputs), outs = width_of(S->output_width, S->outputs);
    int k, p, j;
    mdlStart(S);
    for (k = 0; k < steps && !S->error; k++) {
        const double *row = in + ins * k;
        double *result = out + outs * k;
        for (p = 0; p < S->inputs; p++) {
            S->input[p] = row;
            row += S->input_width[p];
        }
        for (p = 0; p < S->outputs; p++) {
            S->output[p] = result;
            result += S->output_width[p];
        }
        if (k == change_at) {
            *changed = to;
            mdlCheckParameters(S);
            mdlProcessParameters(S);
        }
        for (j = 0; j < again; j++) {
            mdlOutputs(S, 0);
        }
        mdlUpdate(S, 0);
    }
    mdlTerminate(S);
    return S->error ? 1 : 0;
}
