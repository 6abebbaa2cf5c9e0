/* As much of Simulink's interface as an S-function of three inputs uses. */
#ifndef SIMSTRUC_H
#define SIMSTRUC_H

typedef int int_T;
typedef double real_T;
typedef struct {
    int parameters, inputs, outputs, sizes[3], widths[2], work;
    double in[3][16], out[2][16], memory[64];
} SimStruct;

#define INHERITED_SAMPLE_TIME (-1.0)
#define SS_OPTION_EXCEPTION_FREE_CODE 1
#define ssSetNumSFcnParams(S, n) ((S)->parameters = (n))
#define ssGetNumSFcnParams(S) ((S)->parameters)
#define ssGetSFcnParamsCount(S) 0
#define ssSetNumContStates(S, n) ((void)(S))
#define ssSetNumDiscStates(S, n) ((void)(S))
#define ssSetNumInputPorts(S, n) ((S)->inputs = (n))
#define ssSetNumOutputPorts(S, n) ((S)->outputs = (n))
#define ssSetInputPortWidth(S, port, n) ((S)->sizes[port] = (n))
#define ssSetInputPortRequiredContiguous(S, port, yes) ((void)(S))
#define ssSetInputPortDirectFeedThrough(S, port, yes) ((void)(S))
#define ssSetOutputPortWidth(S, port, n) ((S)->widths[port] = (n))
#define ssSetNumRWork(S, n) ((S)->work = (n))
#define ssSetNumSampleTimes(S, n) ((void)(S))
#define ssSetSampleTime(S, k, t) ((void)(S))
#define ssSetOffsetTime(S, k, t) ((void)(S))
#define ssSetOptions(S, options) ((void)(S))
#define ssGetInputPortSignal(S, port) ((const void *)(S)->in[port])
#define ssGetOutputPortSignal(S, port) ((void *)(S)->out[port])
#define ssGetRWork(S) ((S)->memory)

#endif
