"""C code of the FMI 2.0 co-simulation interface around a model's functions."""

from collections.abc import Sequence

from steelyard.export.code.c_code import CCode

FMI2_TYPES = """\
#include <stddef.h>
#include <string.h>

#if defined _WIN32 || defined __CYGWIN__
#define EXPORT __declspec(dllexport)
#elif defined __GNUC__
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

/* Types of FMI 2.0. */
typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum {
    fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated
} fmi2StatusKind;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;
"""

NOT_OFFERED = (
    ("GetFMUstate", "fmi2Component c, fmi2FMUstate *state"),
    ("SetFMUstate", "fmi2Component c, fmi2FMUstate state"),
    ("FreeFMUstate", "fmi2Component c, fmi2FMUstate *state"),
    ("SerializedFMUstateSize", "fmi2Component c, fmi2FMUstate state, size_t *size"),
    ("SerializeFMUstate", "fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size"),
    (
        "DeSerializeFMUstate",
        "fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state",
    ),
    (
        "GetDirectionalDerivative",
        "fmi2Component c, const fmi2ValueReference unknown[], size_t nUnknown, "
        "const fmi2ValueReference known[], size_t nKnown, const fmi2Real seed[], fmi2Real values[]",
    ),
    (
        "SetRealInputDerivatives",
        "fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2Integer order[], "
        "const fmi2Real values[]",
    ),
    (
        "GetRealOutputDerivatives",
        "fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2Integer order[], "
        "fmi2Real values[]",
    ),
    ("CancelStep", "fmi2Component c"),
    ("GetStatus", "fmi2Component c, const fmi2StatusKind kind, fmi2Status *value"),
    ("GetRealStatus", "fmi2Component c, const fmi2StatusKind kind, fmi2Real *value"),
    ("GetIntegerStatus", "fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value"),
    ("GetBooleanStatus", "fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value"),
    ("GetStringStatus", "fmi2Component c, const fmi2StatusKind kind, fmi2String *value"),
)
"""Functions of the interface that the model description does not offer."""


def fmi2_code(code: CCode, guid: str, starts: Sequence[float]) -> str:
    """The source file beside that of a model with a torque or a state; `starts` of all inputs."""
    name, n = code.name, code.controller.model.robot.n
    inputs, outputs = 3 * n, n + bool(code.passive)
    return f"""\
/* FMI 2.0 co-simulation of {name}.c: inputs are positions, velocities and accelerations of all
   joints, outputs their efforts at the inputs of the last step. */
#include "{name}.h"

{FMI2_TYPES}
#define INPUTS {inputs}
#define VALUES {inputs + outputs}

typedef struct {{
    double values[VALUES];
    int begun;
    fmi2CallbackFunctions call;
{fields(code)}}} Instance;

static void set_starts(Instance *me)
{{
    static const double starts[INPUTS] = {{{", ".join(map(repr, starts))}}};
    memset(me->values, 0, sizeof me->values);
    memcpy(me->values, starts, sizeof starts);
    me->begun = 0;
}}

static fmi2Status evaluate(Instance *me)
{{
    const double *q = me->values, *dq = q + {n}, *ddq = dq + {n};
    double *tau = me->values + INPUTS;
{evaluation(code)}
    me->begun = 1;
    return fmi2OK;
}}

EXPORT const char *fmi2GetTypesPlatform(void)
{{
    return "default";
}}

EXPORT const char *fmi2GetVersion(void)
{{
    return "2.0";
}}

EXPORT fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type type, fmi2String guid,
    fmi2String location, const fmi2CallbackFunctions *functions, fmi2Boolean visible,
    fmi2Boolean loggingOn)
{{
    Instance *me;
    (void)instanceName, (void)location, (void)visible, (void)loggingOn;
    if (type != fmi2CoSimulation || !functions || !guid || strcmp(guid, "{guid}") != 0) {{
        return NULL;
    }}
    me = (Instance *)functions->allocateMemory(1, sizeof(Instance));
    if (me) {{
        me->call = *functions;
        set_starts(me);
    }}
    return me;
}}

EXPORT void fmi2FreeInstance(fmi2Component c)
{{
    if (c) {{
        ((Instance *)c)->call.freeMemory(c);
    }}
}}

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count,
    const fmi2String categories[])
{{
    (void)c, (void)on, (void)count, (void)categories;
    return fmi2OK;
}}

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined,
    fmi2Real tolerance, fmi2Real start, fmi2Boolean stopDefined, fmi2Real stop)
{{
    (void)c, (void)toleranceDefined, (void)tolerance, (void)start, (void)stopDefined, (void)stop;
    return fmi2OK;
}}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{{
    (void)c;
    return fmi2OK;
}}

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{{
    return evaluate((Instance *)c);
}}

EXPORT fmi2Status fmi2Terminate(fmi2Component c)
{{
    (void)c;
    return fmi2OK;
}}

EXPORT fmi2Status fmi2Reset(fmi2Component c)
{{
    set_starts((Instance *)c);
    return fmi2OK;
}}

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count,
    fmi2Real values[])
{{
    size_t i;
    for (i = 0; i < count; ++i) {{
        if (vr[i] >= VALUES) {{
            return fmi2Error;
        }}
        values[i] = ((Instance *)c)->values[vr[i]];
    }}
    return fmi2OK;
}}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count,
    const fmi2Real values[])
{{
    size_t i;
    for (i = 0; i < count; ++i) {{
        if (vr[i] >= INPUTS) {{
            return fmi2Error;
        }}
        ((Instance *)c)->values[vr[i]] = values[i];
    }}
    return fmi2OK;
}}

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean noSetBack)
{{
    (void)time, (void)step, (void)noSetBack;
    return evaluate((Instance *)c);
}}

{_other_types()}{_not_offered()}"""


def fields(code: CCode) -> str:
    """Fields of a struct for what `evaluation` keeps from sample to sample, beside `begun`."""
    if code.controller.n_memory:
        return f"    {code.name}_state state;\n"
    return f"    double passive[{code.passive}];\n" if code.passive else ""


def evaluation(code: CCode) -> str:
    """Efforts `tau` at `q`, `dq` and `ddq`, then the closure error; a first call starts `me`."""
    name, n = code.name, code.controller.model.robot.n
    gap = f"tau[{n}] = " if code.passive else ""
    if code.controller.n_memory:
        return f"""\
    if (!me->begun) {{
        {gap}{name}_start(&me->state, q, dq);
    }}
    {gap}{name}_step(&me->state, q, dq, ddq, tau);"""
    if code.passive:
        return f"""\
    {gap}me->begun ? {name}_close(q, me->passive) : {name}_follow(q, me->passive);
    {name}_torque(q, me->passive, dq, ddq, tau);"""
    return f"    {name}_torque(q, dq, ddq, tau);"


def _other_types() -> str:
    """There are no variables of other types."""
    return "".join(
        f"""\
EXPORT fmi2Status fmi2{way}{kind}(fmi2Component c, const fmi2ValueReference vr[], size_t count,
    {const}fmi2{kind} values[])
{{
    (void)c, (void)vr, (void)values;
    return count ? fmi2Error : fmi2OK;
}}

"""
        for kind in ("Integer", "Boolean", "String")
        for way, const in (("Get", ""), ("Set", "const "))
    )


def _not_offered() -> str:
    parts = []
    for name, arguments in NOT_OFFERED:
        names = (part.split()[-1].strip("*[]") for part in arguments.split(","))
        unread = ", ".join(f"(void){x}" for x in names)
        parts.append(
            f"EXPORT fmi2Status fmi2{name}({arguments})\n"
            f"{{\n    {unread};\n    return fmi2Error;\n}}\n"
        )
    return "\n".join(parts)
