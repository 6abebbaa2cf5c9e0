/* S-function of [[ name ]].c: inputs q, dq and ddq, output tau[% if passive %], then the closure error[% endif %]. */
#define S_FUNCTION_NAME [[ block ]]
#define S_FUNCTION_LEVEL 2

#include "simstruc.h"

#include <string.h>

#include "[[ name ]].h"

#define JOINTS [[ n ]]
#define OUTPUTS [[ n + (passive > 0) ]]
[% if passive or memory %]

/* What is remembered between samples, in the work vector of the block. */
typedef struct {
    int begun;
[% if memory %]
    [[ name ]]_state state;
[% elif passive %]
    double passive[[[ passive ]]];
[% endif %]
} Instance;

#define WORK ((int_T)((sizeof(Instance) + sizeof(real_T) - 1) / sizeof(real_T)))
[% endif %]

static void evaluate(SimStruct *S[% if passive or memory %], Instance *me[% endif %], double tau[OUTPUTS])
{
    const double *q = (const double *)ssGetInputPortSignal(S, 0);
    const double *dq = (const double *)ssGetInputPortSignal(S, 1);
    const double *ddq = (const double *)ssGetInputPortSignal(S, 2);
[% include "efforts_of_sample.c" %]
}

static void mdlInitializeSizes(SimStruct *S)
{
    int port;
    ssSetNumSFcnParams(S, 0);
    if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S)) {
        return;
    }
    ssSetNumContStates(S, 0);
    ssSetNumDiscStates(S, 0);
    if (!ssSetNumInputPorts(S, 3) || !ssSetNumOutputPorts(S, [[ 1 + (passive > 0) ]])) {
        return;
    }
    for (port = 0; port < 3; ++port) {
        ssSetInputPortWidth(S, port, JOINTS);
        ssSetInputPortRequiredContiguous(S, port, 1);
        ssSetInputPortDirectFeedThrough(S, port, 1);
    }
    ssSetOutputPortWidth(S, 0, JOINTS);
[% if passive %]
    ssSetOutputPortWidth(S, 1, 1);
[% endif %]
    ssSetNumRWork(S, [[ "WORK" if passive or memory else 0 ]]);
    ssSetNumSampleTimes(S, 1);
    ssSetOptions(S, SS_OPTION_EXCEPTION_FREE_CODE);
}

static void mdlInitializeSampleTimes(SimStruct *S)
{
    ssSetSampleTime(S, 0, INHERITED_SAMPLE_TIME);
    ssSetOffsetTime(S, 0, 0.0);
}

[% if passive or memory %]
#define MDL_INITIALIZE_CONDITIONS
static void mdlInitializeConditions(SimStruct *S)
{
    memset(ssGetRWork(S), 0, sizeof(Instance));
}

[% endif %]
static void mdlOutputs(SimStruct *S, int_T tid)
{
    double tau[OUTPUTS];
[% if passive or memory %]
    Instance me;
    memcpy(&me, ssGetRWork(S), sizeof me);
[% endif %]
    (void)tid;
    evaluate(S[% if passive or memory %], &me[% endif %], tau);
    memcpy(ssGetOutputPortSignal(S, 0), tau, JOINTS * sizeof *tau);
[% if passive %]
    memcpy(ssGetOutputPortSignal(S, 1), tau + JOINTS, sizeof *tau);
[% endif %]
}

[% if passive or memory %]
/* Outputs may be computed several times a step: the state changes here only. */
#define MDL_UPDATE
static void mdlUpdate(SimStruct *S, int_T tid)
{
    double tau[OUTPUTS];
    Instance me;
    memcpy(&me, ssGetRWork(S), sizeof me);
    (void)tid;
    evaluate(S, &me, tau);
    me.begun = 1;
    memcpy(ssGetRWork(S), &me, sizeof me);
}

[% endif %]
static void mdlTerminate(SimStruct *S)
{
    (void)S;
}

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
