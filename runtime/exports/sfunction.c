/* --- Simulink: a level 2 C MEX S-function over the part --------------------------------------------------------- */

/* Build it in MATLAB: mex COPTIMFLAGS="-O2 -ffp-contract=off" BLOCK.c (with another compiler: its own flag for
 * strict floating point). Ports and parameters are listed at their tables above: a port is a vector of doubles, a
 * parameter a vector in the order of its list, or [] for the drive's own values. */
#define S_FUNCTION_LEVEL 2
#include "simstruc.h"
#include <stdlib.h>

/* The part as it is, and as it will be after this sample. */
typedef struct {
    part_t now;
    part_t next;
} block_t;

/* Parameters that were given; fixed ones act before the first sample alone. */
static void take_parameters(SimStruct *S, part_t *part, int starting)
{
    int p;
    unsigned k;
    for (p = 0; p < PARAMETER_PORTS; p++) {
        const mxArray *given = ssGetSFcnParam(S, p);
        if (mxGetNumberOfElements(given) == 0 || (!starting && !PARAMETERS[p].tunable)) {
            continue;
        }
        for (k = 0; k < PARAMETERS[p].count; k++) {
            set_value(part, PARAMETERS[p].first + k, mxGetPr(given)[k]);
        }
    }
}

#define MDL_CHECK_PARAMETERS
static void mdlCheckParameters(SimStruct *S)
{
    static char text[128];
    int p;
    for (p = 0; p < PARAMETER_PORTS; p++) {
        const mxArray *given = ssGetSFcnParam(S, p);
        const size_t count = mxGetNumberOfElements(given);
        if (count != 0 && (count != PARAMETERS[p].count || !mxIsDouble(given) || mxIsComplex(given))) {
            sprintf(text, "parameter %d, %.40s, is [] or %u real numbers", p + 1, PARAMETERS[p].name, PARAMETERS[p].count);
            ssSetErrorStatus(S, text);
            return;
        }
    }
}

static void mdlInitializeSizes(SimStruct *S)
{
    int p;
    ssSetNumSFcnParams(S, PARAMETER_PORTS);
    if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S)) {
        return; /* Simulink says so */
    }
    mdlCheckParameters(S);
    if (ssGetErrorStatus(S) != NULL) {
        return;
    }
    for (p = 0; p < PARAMETER_PORTS; p++) {
        ssSetSFcnParamTunable(S, p, PARAMETERS[p].tunable);
    }
    ssSetNumContStates(S, 0);
    ssSetNumDiscStates(S, 0);
    if (!ssSetNumInputPorts(S, INPUT_PORTS) || !ssSetNumOutputPorts(S, OUTPUT_PORTS)) {
        return;
    }
    for (p = 0; p < INPUT_PORTS; p++) {
        ssSetInputPortWidth(S, p, (int)INPUTS[p].count);
        ssSetInputPortDataType(S, p, SS_DOUBLE);
        ssSetInputPortRequiredContiguous(S, p, 1);
        ssSetInputPortDirectFeedThrough(S, p, FEEDTHROUGH);
    }
    for (p = 0; p < OUTPUT_PORTS; p++) {
        ssSetOutputPortWidth(S, p, (int)OUTPUTS[p].count);
        ssSetOutputPortDataType(S, p, SS_DOUBLE);
    }
    ssSetNumSampleTimes(S, 1);
    ssSetNumPWork(S, 1);
    ssSetOptions(S, SS_OPTION_EXCEPTION_FREE_CODE);
}

static void mdlInitializeSampleTimes(SimStruct *S)
{
    ssSetSampleTime(S, 0, SAMPLE_TIME);
    ssSetOffsetTime(S, 0, 0.0);
}

#define MDL_START
static void mdlStart(SimStruct *S)
{
    block_t *block = (block_t *)calloc(1, sizeof *block);
    if (!block) {
        ssSetErrorStatus(S, "no memory");
        return;
    }
    part_init(&block->now);
    take_parameters(S, &block->now, 1);
    part_begin(&block->now);
    block->next = block->now;
    ssGetPWork(S)[0] = block;
}

#define MDL_PROCESS_PARAMETERS
static void mdlProcessParameters(SimStruct *S)
{
    block_t *block = (block_t *)ssGetPWork(S)[0];
    take_parameters(S, &block->now, 0);
}

/* The sample that begins now, from the inputs of now; taken again, it is the same one. */
static void take_sample(SimStruct *S, block_t *block)
{
    int p;
    unsigned k;
    block->next = block->now;
    for (p = 0; p < INPUT_PORTS; p++) {
        const double *input = (const double *)ssGetInputPortSignal(S, p);
        for (k = 0; k < INPUTS[p].count; k++) {
            set_value(&block->next, INPUTS[p].first + k, input[k]);
        }
    }
    part_step(&block->next);
}

static void mdlOutputs(SimStruct *S, int_T tid)
{
    block_t *block = (block_t *)ssGetPWork(S)[0];
    int p;
    unsigned k;
    (void)tid;
    if (FEEDTHROUGH) {
        take_sample(S, block);
    }
    for (p = 0; p < OUTPUT_PORTS; p++) {
        double *output = (double *)ssGetOutputPortSignal(S, p);
        for (k = 0; k < OUTPUTS[p].count; k++) {
            output[k] = value_of(FEEDTHROUGH ? &block->next : &block->now, OUTPUTS[p].first + k);
        }
    }
}

#define MDL_UPDATE
static void mdlUpdate(SimStruct *S, int_T tid)
{
    block_t *block = (block_t *)ssGetPWork(S)[0];
    (void)tid;
    if (!FEEDTHROUGH) {
        take_sample(S, block);
    }
    block->now = block->next;
}

static void mdlTerminate(SimStruct *S)
{
    free(ssGetPWork(S)[0]);
    ssGetPWork(S)[0] = NULL;
}

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
