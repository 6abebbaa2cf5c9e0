"""C code of the FMI 3.0 co-simulation interface around a model's functions."""

from collections.abc import Sequence

from steelyard.application.controller.c_code import CCode
from steelyard.application.controller.fmi2_code import EXPORT, instance_code, refusing

TYPES = """\
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* Types of FMI 3.0. */
typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean;
typedef const char *fmi3String;
typedef uint8_t fmi3Byte;
typedef const fmi3Byte *fmi3Binary;
typedef bool fmi3Clock;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef int fmi3DependencyKind;
typedef int fmi3IntervalQualifier;
typedef void (*fmi3LogMessageCallback)(
    fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean,
    fmi3Boolean, fmi3Boolean, fmi3Boolean, fmi3Boolean *, fmi3Float64 *);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3PreemptionCallback)(void);
"""

_C = "fmi3Instance c"
_VR = f"{_C}, const fmi3ValueReference vr[], size_t count"
_DERIVATIVE = (
    f"{_C}, const fmi3ValueReference unknowns[], size_t nUnknowns, "
    "const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed, "
    "fmi3Float64 sensitivity[], size_t nSensitivity"
)
_NEW = (
    "fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible, "
    "fmi3Boolean loggingOn, "
)
_NUMBERS = "fmi3UInt64 counters[], fmi3UInt64 resolutions[]"

OTHER_TYPES = (
    *("Float32", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64"),
    *("Boolean", "String"),
)
"""Types that no variable has."""

NOT_OFFERED = (
    ("GetBinary", f"{_VR}, size_t sizes[], fmi3Binary values[], size_t nValues"),
    ("SetBinary", f"{_VR}, const size_t sizes[], const fmi3Binary values[], size_t nValues"),
    ("GetClock", f"{_VR}, fmi3Clock values[]"),
    ("SetClock", f"{_VR}, const fmi3Clock values[]"),
    ("GetNumberOfVariableDependencies", f"{_C}, fmi3ValueReference vr, size_t *number"),
    (
        "GetVariableDependencies",
        f"{_C}, fmi3ValueReference vr, size_t places[], fmi3ValueReference independents[], "
        "size_t others[], fmi3DependencyKind kinds[], size_t count",
    ),
    ("GetFMUState", f"{_C}, fmi3FMUState *state"),
    ("SetFMUState", f"{_C}, fmi3FMUState state"),
    ("FreeFMUState", f"{_C}, fmi3FMUState *state"),
    ("SerializedFMUStateSize", f"{_C}, fmi3FMUState state, size_t *size"),
    ("SerializeFMUState", f"{_C}, fmi3FMUState state, fmi3Byte bytes[], size_t size"),
    ("DeserializeFMUState", f"{_C}, const fmi3Byte bytes[], size_t size, fmi3FMUState *state"),
    ("GetDirectionalDerivative", _DERIVATIVE),
    ("GetAdjointDerivative", _DERIVATIVE),
    ("EnterConfigurationMode", _C),
    ("ExitConfigurationMode", _C),
    (
        "GetIntervalDecimal",
        f"{_VR}, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]",
    ),
    ("GetIntervalFraction", f"{_VR}, {_NUMBERS}, fmi3IntervalQualifier qualifiers[]"),
    ("GetShiftDecimal", f"{_VR}, fmi3Float64 shifts[]"),
    ("GetShiftFraction", f"{_VR}, {_NUMBERS}"),
    ("SetIntervalDecimal", f"{_VR}, const fmi3Float64 intervals[]"),
    (
        "SetIntervalFraction",
        f"{_VR}, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]",
    ),
    ("SetShiftDecimal", f"{_VR}, const fmi3Float64 shifts[]"),
    ("SetShiftFraction", f"{_VR}, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]"),
    ("EvaluateDiscreteStates", _C),
    (
        "UpdateDiscreteStates",
        f"{_C}, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals, "
        "fmi3Boolean *values, fmi3Boolean *defined, fmi3Float64 *next",
    ),
    ("EnterEventMode", _C),
    ("EnterContinuousTimeMode", _C),
    (
        "CompletedIntegratorStep",
        f"{_C}, fmi3Boolean noSetBack, fmi3Boolean *enter, fmi3Boolean *terminate",
    ),
    ("SetTime", f"{_C}, fmi3Float64 time"),
    ("SetContinuousStates", f"{_C}, const fmi3Float64 states[], size_t count"),
    ("GetContinuousStateDerivatives", f"{_C}, fmi3Float64 derivatives[], size_t count"),
    ("GetEventIndicators", f"{_C}, fmi3Float64 indicators[], size_t count"),
    ("GetContinuousStates", f"{_C}, fmi3Float64 states[], size_t count"),
    ("GetNominalsOfContinuousStates", f"{_C}, fmi3Float64 nominals[], size_t count"),
    ("GetNumberOfEventIndicators", f"{_C}, size_t *count"),
    ("GetNumberOfContinuousStates", f"{_C}, size_t *count"),
    ("EnterStepMode", _C),
    (
        "GetOutputDerivatives",
        f"{_VR}, const fmi3Int32 orders[], fmi3Float64 values[], size_t nValues",
    ),
    ("ActivateModelPartition", f"{_C}, fmi3ValueReference clock, fmi3Float64 time"),
)
"""Functions of the interface that the model description does not offer."""

NO_INSTANCES = (
    (
        "InstantiateModelExchange",
        f"{_NEW}fmi3InstanceEnvironment environment, fmi3LogMessageCallback logMessage",
    ),
    (
        "InstantiateScheduledExecution",
        f"{_NEW}fmi3InstanceEnvironment environment, fmi3LogMessageCallback logMessage, "
        "fmi3ClockUpdateCallback update, fmi3PreemptionCallback lock, "
        "fmi3PreemptionCallback unlock",
    ),
)
"""Kinds of units that this one is not."""


def fmi3_code(code: CCode, token: str, starts: Sequence[float]) -> str:
    """The source file beside the model's own.

    Args:
        code: The model in C, with a torque or with a state.
        token: The instantiation token, as in the model description.
        starts: Values of all inputs at the start.
    """
    others = "".join(
        refusing(
            "fmi3",
            [(f"{way}{kind}", f"{_VR}, {const}fmi3{kind} values[], size_t nValues")],
            "count ? fmi3Error : fmi3OK",
        )
        for kind in OTHER_TYPES
        for way, const in (("Get", ""), ("Set", "const "))
    )
    none = refusing("fmi3", NO_INSTANCES, "NULL", "fmi3Instance")
    return f"""\
/* FMI 3.0 co-simulation of {code.name}.c: inputs are positions, velocities and accelerations of all
   joints, outputs their efforts at the inputs of the last step. */
#include "{code.name}.h"

{TYPES}
{EXPORT}
{instance_code(code, starts, "fmi3", "    double time;")}
EXPORT const char *fmi3GetVersion(void)
{{
    return "3.0";
}}

EXPORT fmi3Instance fmi3InstantiateCoSimulation({_NEW}fmi3Boolean eventModeUsed,
    fmi3Boolean earlyReturnAllowed, const fmi3ValueReference intermediate[], size_t nIntermediate,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback logMessage,
    fmi3IntermediateUpdateCallback update)
{{
    Instance *me;
    (void)name, (void)path, (void)visible, (void)loggingOn, (void)eventModeUsed;
    (void)earlyReturnAllowed, (void)intermediate, (void)nIntermediate, (void)environment;
    (void)logMessage, (void)update;
    if (!token || strcmp(token, "{token}") != 0) {{
        return NULL;
    }}
    me = (Instance *)calloc(1, sizeof(Instance));
    if (me) {{
        set_starts(me);
    }}
    return me;
}}

EXPORT void fmi3FreeInstance(fmi3Instance c)
{{
    free(c);
}}

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean toleranceDefined,
    fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean stopDefined, fmi3Float64 stop)
{{
    (void)toleranceDefined, (void)tolerance, (void)stopDefined, (void)stop;
    ((Instance *)c)->time = start;
    return fmi3OK;
}}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{{
    return evaluate((Instance *)c);
}}

EXPORT fmi3Status fmi3Reset(fmi3Instance c)
{{
    set_starts((Instance *)c);
    return fmi3OK;
}}

EXPORT fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
    fmi3Float64 values[], size_t nValues)
{{
    const Instance *me = (const Instance *)c;
    size_t i;
    for (i = 0; i < count; ++i) {{
        if (vr[i] > VALUES || nValues != count) {{
            return fmi3Error;
        }}
        values[i] = vr[i] == VALUES ? me->time : me->values[vr[i]];
    }}
    return fmi3OK;
}}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
    const fmi3Float64 values[], size_t nValues)
{{
    size_t i;
    for (i = 0; i < count; ++i) {{
        if (vr[i] >= INPUTS || nValues != count) {{
            return fmi3Error;
        }}
        ((Instance *)c)->values[vr[i]] = values[i];
    }}
    return fmi3OK;
}}

EXPORT fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 step,
    fmi3Boolean noSetBack, fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early,
    fmi3Float64 *last)
{{
    (void)noSetBack;
    *event = *terminate = *early = false;
    *last = ((Instance *)c)->time = time + step;
    return evaluate((Instance *)c);
}}

{refusing("fmi3", (("Terminate", _C),), "fmi3OK")}\
{
        refusing(
            "fmi3",
            (("SetDebugLogging", f"{_C}, fmi3Boolean on, size_t n, const fmi3String x[]"),),
            "fmi3OK",
        )
    }\
{none}{others}{refusing("fmi3", NOT_OFFERED, "fmi3Error")}"""
