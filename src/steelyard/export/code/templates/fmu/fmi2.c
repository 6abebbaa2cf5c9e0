/* FMI 2.0 co-simulation of [[ name ]].c: inputs are positions, velocities and accelerations of all
   joints, outputs their efforts at the inputs of the last step. */
#include "[[ name ]].h"

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

#define INPUTS [[ 3 * n ]]
#define VALUES [[ 4 * n + (passive > 0) ]]

typedef struct {
    double values[VALUES];
    int begun;
    fmi2CallbackFunctions call;
[% if memory %]
    [[ name ]]_state state;
[% elif passive %]
    double passive[[[ passive ]]];
[% endif %]
} Instance;

static void set_starts(Instance *me)
{
    static const double starts[INPUTS] = {[[ starts | join(", ") ]]};
    memset(me->values, 0, sizeof me->values);
    memcpy(me->values, starts, sizeof starts);
    me->begun = 0;
}

static fmi2Status evaluate(Instance *me)
{
    const double *q = me->values, *dq = q + [[ n ]], *ddq = dq + [[ n ]];
    double *tau = me->values + INPUTS;
[% include "efforts_of_sample.c" %]
    me->begun = 1;
    return fmi2OK;
}

EXPORT const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

EXPORT const char *fmi2GetVersion(void)
{
    return "2.0";
}

EXPORT fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type type, fmi2String guid,
    fmi2String location, const fmi2CallbackFunctions *functions, fmi2Boolean visible,
    fmi2Boolean loggingOn)
{
    Instance *me;
    (void)instanceName, (void)location, (void)visible, (void)loggingOn;
    if (type != fmi2CoSimulation || !functions || !guid || strcmp(guid, "[[ guid ]]") != 0) {
        return NULL;
    }
    me = (Instance *)functions->allocateMemory(1, sizeof(Instance));
    if (me) {
        me->call = *functions;
        set_starts(me);
    }
    return me;
}

EXPORT void fmi2FreeInstance(fmi2Component c)
{
    if (c) {
        ((Instance *)c)->call.freeMemory(c);
    }
}

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    return evaluate((Instance *)c);
}

EXPORT fmi2Status fmi2Reset(fmi2Component c)
{
    set_starts((Instance *)c);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count,
    fmi2Real values[])
{
    size_t i;
    for (i = 0; i < count; ++i) {
        if (vr[i] >= VALUES) {
            return fmi2Error;
        }
        values[i] = ((Instance *)c)->values[vr[i]];
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count,
    const fmi2Real values[])
{
    size_t i;
    for (i = 0; i < count; ++i) {
        if (vr[i] >= INPUTS) {
            return fmi2Error;
        }
        ((Instance *)c)->values[vr[i]] = values[i];
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean noSetBack)
{
    (void)time, (void)step, (void)noSetBack;
    return evaluate((Instance *)c);
}

/* What there is nothing of here: numbers of other types, states, derivatives, steps to wait for. */
[% macro without(name, given, answer) %]
EXPORT fmi2Status fmi2[[ name ]](fmi2Component c[[ ", " * (given != "") ]][[ given ]])
{
    (void)c[% for x in given.split(", ") if x %], (void)[[ x.split()[-1].strip("*[]") ]][% endfor %];
    return [[ answer ]];
}
[% endmacro %]
[% set values = "const fmi2ValueReference vr[], size_t count" %]
[% for kind in ("Integer", "Boolean", "String") %]
[[ without("Get" ~ kind, values ~ ", fmi2" ~ kind ~ " values[]", "count ? fmi2Error : fmi2OK") ]]
[[ without("Set" ~ kind, values ~ ", const fmi2" ~ kind ~ " values[]", "count ? fmi2Error : fmi2OK") ]]
[% endfor %]
[% for name, given in {
    "SetDebugLogging": "fmi2Boolean on, size_t count, const fmi2String categories[]",
    "SetupExperiment": "fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real start, "
        ~ "fmi2Boolean stopDefined, fmi2Real stop",
    "EnterInitializationMode": "",
    "Terminate": "",
}.items() %]
[[ without(name, given, "fmi2OK") ]]
[% endfor %]
[% for name, given in {
    "GetFMUstate": "fmi2FMUstate *state",
    "SetFMUstate": "fmi2FMUstate state",
    "FreeFMUstate": "fmi2FMUstate *state",
    "SerializedFMUstateSize": "fmi2FMUstate state, size_t *size",
    "SerializeFMUstate": "fmi2FMUstate state, fmi2Byte bytes[], size_t size",
    "DeSerializeFMUstate": "const fmi2Byte bytes[], size_t size, fmi2FMUstate *state",
    "GetDirectionalDerivative": "const fmi2ValueReference unknown[], size_t nUnknown, "
        ~ "const fmi2ValueReference known[], size_t nKnown, const fmi2Real seed[], fmi2Real values[]",
    "SetRealInputDerivatives": values ~ ", const fmi2Integer order[], const fmi2Real values[]",
    "GetRealOutputDerivatives": values ~ ", const fmi2Integer order[], fmi2Real values[]",
    "CancelStep": "",
    "GetStatus": "const fmi2StatusKind kind, fmi2Status *value",
    "GetRealStatus": "const fmi2StatusKind kind, fmi2Real *value",
    "GetIntegerStatus": "const fmi2StatusKind kind, fmi2Integer *value",
    "GetBooleanStatus": "const fmi2StatusKind kind, fmi2Boolean *value",
    "GetStringStatus": "const fmi2StatusKind kind, fmi2String *value",
}.items() %]
[[ without(name, given, "fmi2Error") ]]
[% endfor %]
