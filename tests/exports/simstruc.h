/* simstruc.h: as much of Simulink's S-function interface as a test needs, written from its documentation. */
#ifndef SIMSTRUC_H
#define SIMSTRUC_H
#include <stddef.h>
#include <stdio.h>

typedef double real_T;
typedef int int_T;
typedef struct {
    size_t count;
    double *values;
    int complex, other;
} mxArray;

#define MOST 32
typedef struct {
    int expected, given, inputs, outputs, pwork_count, sample_times, options;
    int tunable[MOST], input_width[MOST], output_width[MOST], contiguous[MOST], feedthrough[MOST];
    double period, shift;
    const mxArray *parameter[MOST];
    const double *input[MOST];
    double *output[MOST];
    void *pwork[MOST];
    const char *error;
} SimStruct;

#define SS_DOUBLE 0
#define SS_OPTION_EXCEPTION_FREE_CODE 1
#define ssSetNumSFcnParams(S, n) ((S)->expected = (n))
#define ssGetNumSFcnParams(S) ((S)->expected)
#define ssGetSFcnParamsCount(S) ((S)->given)
#define ssGetSFcnParam(S, p) ((S)->parameter[p])
#define ssSetSFcnParamTunable(S, p, t) ((S)->tunable[p] = (t))
#define ssSetNumContStates(S, n) ((void)(S), (void)(n))
#define ssSetNumDiscStates(S, n) ((void)(S), (void)(n))
#define ssSetNumInputPorts(S, n) ((S)->inputs = (n), (n) <= MOST)
#define ssSetNumOutputPorts(S, n) ((S)->outputs = (n), (n) <= MOST)
#define ssSetInputPortWidth(S, p, n) ((S)->input_width[p] = (n))
#define ssSetInputPortDataType(S, p, t) ((void)(t))
#define ssSetInputPortRequiredContiguous(S, p, c) ((S)->contiguous[p] = (c))
#define ssSetInputPortDirectFeedThrough(S, p, f) ((S)->feedthrough[p] = (f))
#define ssSetOutputPortWidth(S, p, n) ((S)->output_width[p] = (n))
#define ssSetOutputPortDataType(S, p, t) ((void)(t))
#define ssSetNumSampleTimes(S, n) ((S)->sample_times = (n))
#define ssSetNumPWork(S, n) ((S)->pwork_count = (n))
#define ssSetOptions(S, o) ((S)->options = (o))
#define ssSetSampleTime(S, k, t) ((S)->period = (t))
#define ssSetOffsetTime(S, k, t) ((S)->shift = (t))
#define ssGetPWork(S) ((S)->pwork)
#define ssGetInputPortSignal(S, p) ((const void *)(S)->input[p])
#define ssGetOutputPortSignal(S, p) ((void *)(S)->output[p])
#define ssSetErrorStatus(S, text) ((S)->error = (text))
#define ssGetErrorStatus(S) ((S)->error)
#define mxGetNumberOfElements(a) ((a)->count)
#define mxGetPr(a) ((a)->values)
#define mxIsDouble(a) (!(a)->other)
#define mxIsComplex(a) ((a)->complex)
#endif
