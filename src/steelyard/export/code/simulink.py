"""A model as an S-function for Simulink (level 2, C MEX), around the C code."""

from steelyard.export.code.c_code import CCode, commented, joint_list
from steelyard.export.code.c_files import self_test
from steelyard.export.code.fmu import evaluation, fields

LONGEST_NAME = 63  # characters of names in MATLAB


def simulink_files(code: CCode) -> dict[str, str]:
    """Contents by the names of the files, of a model in double precision."""
    block = f"{code.name[: LONGEST_NAME - len('make__sfun')]}_sfun"
    return {
        f"{code.name}.h": code.header(),
        f"{code.name}.c": code.source(),
        f"{code.name}_test.c": self_test(code),
        f"{block}.c": _s_function(code, block),
        f"make_{block}.m": f"% Compile the S-function {block}.\nmex {block}.c {code.name}.c\n",
        "README.md": _readme(code, block),
    }


def _s_function(code: CCode, block: str) -> str:
    n, stateful = code.controller.model.robot.n, bool(code.controller.n_memory or code.passive)
    closed = bool(code.passive)
    error = ", then the closure error" if closed else ""
    return f"""\
/* S-function of {code.name}.c: inputs q, dq and ddq, output tau{error}. */
#define S_FUNCTION_NAME {block}
#define S_FUNCTION_LEVEL 2

#include "simstruc.h"

#include <string.h>

#include "{code.name}.h"

#define JOINTS {n}
#define OUTPUTS {n + closed}
{_STATE.format(fields=fields(code)) if stateful else ""}
static void evaluate(SimStruct *S{", Instance *me" * stateful}, double tau[OUTPUTS])
{{
    const double *q = (const double *)ssGetInputPortSignal(S, 0);
    const double *dq = (const double *)ssGetInputPortSignal(S, 1);
    const double *ddq = (const double *)ssGetInputPortSignal(S, 2);
{evaluation(code)}
}}

static void mdlInitializeSizes(SimStruct *S)
{{
    int port;
    ssSetNumSFcnParams(S, 0);
    if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S)) {{
        return;
    }}
    ssSetNumContStates(S, 0);
    ssSetNumDiscStates(S, 0);
    if (!ssSetNumInputPorts(S, 3) || !ssSetNumOutputPorts(S, {1 + closed})) {{
        return;
    }}
    for (port = 0; port < 3; ++port) {{
        ssSetInputPortWidth(S, port, JOINTS);
        ssSetInputPortRequiredContiguous(S, port, 1);
        ssSetInputPortDirectFeedThrough(S, port, 1);
    }}
    ssSetOutputPortWidth(S, 0, JOINTS);
{"    ssSetOutputPortWidth(S, 1, 1);" + chr(10) if closed else ""}\
    ssSetNumRWork(S, {"WORK" if stateful else 0});
    ssSetNumSampleTimes(S, 1);
    ssSetOptions(S, SS_OPTION_EXCEPTION_FREE_CODE);
}}

static void mdlInitializeSampleTimes(SimStruct *S)
{{
    ssSetSampleTime(S, 0, INHERITED_SAMPLE_TIME);
    ssSetOffsetTime(S, 0, 0.0);
}}

{_START if stateful else ""}\
static void mdlOutputs(SimStruct *S, int_T tid)
{{
    double tau[OUTPUTS];
{_LOAD if stateful else ""}\
    (void)tid;
    evaluate(S{", &me" * stateful}, tau);
    memcpy(ssGetOutputPortSignal(S, 0), tau, JOINTS * sizeof *tau);
{"    memcpy(ssGetOutputPortSignal(S, 1), tau + JOINTS, sizeof *tau);" + chr(10) if closed else ""}\
}}

{_UPDATE if stateful else ""}\
static void mdlTerminate(SimStruct *S)
{{
    (void)S;
}}

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
"""


_STATE = """
/* What is remembered between samples, in the work vector of the block. */
typedef struct {{
    int begun;
{fields}}} Instance;

#define WORK ((int_T)((sizeof(Instance) + sizeof(real_T) - 1) / sizeof(real_T)))
"""

_LOAD = """\
    Instance me;
    memcpy(&me, ssGetRWork(S), sizeof me);
"""

_START = """\
#define MDL_INITIALIZE_CONDITIONS
static void mdlInitializeConditions(SimStruct *S)
{
    memset(ssGetRWork(S), 0, sizeof(Instance));
}

"""

_UPDATE = f"""\
/* Outputs may be computed several times a step: the state changes here only. */
#define MDL_UPDATE
static void mdlUpdate(SimStruct *S, int_T tid)
{{
    double tau[OUTPUTS];
{_LOAD}\
    (void)tid;
    evaluate(S, &me, tau);
    me.begun = 1;
    memcpy(ssGetRWork(S), &me, sizeof me);
}}

"""


def _readme(code: CCode, block: str) -> str:
    robot = code.controller.model.robot
    memory = (
        "- Friction remembers the motion: steps of the block are its samples. Give it a discrete "
        "sample time.\n"
    )
    chains = (
        "- Closed chains: positions are those of the driven joints. The second output is the "
        "closure error [m].\n"
    )
    return f"""\
# S-function of {commented(robot.name)}

`{block}` computes in Simulink the joint efforts of the identified model: inputs are positions `q`,
velocities `dq` and accelerations `ddq`, the first output the efforts `tau`, all of width {robot.n}.

**Not run in Simulink where it was written.** `{code.name}_test` compares the C code with Python;
the tests of steelyard compile such S-functions against declarations of the interface only. In
MATLAB, with a C compiler:

    make_{block}

Then put a block *S-Function* with the name `{block}` and no parameters into the model.

{memory if code.controller.n_memory else ""}{chains if code.passive else ""}\
- A feedforward takes the desired `q`, `dq` and `ddq`: friction of the measured velocity changes
  sign with its noise.

Entries are in the order of the joints (number, name, units of position and effort):

{joint_list(robot.coordinates)}
"""
