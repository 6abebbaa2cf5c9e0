"""A model as a functional mock-up unit: FMI 2.0 co-simulation, around the C code."""

import hashlib
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np

from steelyard.base.errors import OutputError
from steelyard.export.code.c_code import CCode
from steelyard.robot.loop_closures import loop_equations

PLATFORMS = {
    ("Linux", "x86_64"): ("linux64", ".so"),
    ("Darwin", "x86_64"): ("darwin64", ".dylib"),
    ("Windows", "AMD64"): ("win64", ".dll"),
}
"""Platforms that FMI 2.0 has names for; other ones compile the sources."""

FMI_UNITS = {
    "rad": '<BaseUnit rad="1"/>',
    "rad/s": '<BaseUnit rad="1" s="-1"/>',
    "rad/s2": '<BaseUnit rad="1" s="-2"/>',
    "m": '<BaseUnit m="1"/>',
    "m/s": '<BaseUnit m="1" s="-1"/>',
    "m/s2": '<BaseUnit m="1" s="-2"/>',
    "N.m": '<BaseUnit kg="1" m="2" s="-2"/>',
    "N": '<BaseUnit kg="1" m="1" s="-2"/>',
}


class Variable(NamedTuple):
    """An input or output; its unit is one of `FMI_UNITS`, outputs have no start."""

    name: str
    unit: str
    start: float | None
    meaning: str


def variables_of(code: CCode) -> list[Variable]:
    """Positions, velocities and accelerations, then efforts; with loops the closure error."""
    robot = code.controller.model.robot
    reference = loop_equations(robot).assembly if robot.passive else np.zeros(robot.n)
    joints = list(zip(code.joints, robot.joint_names, robot.coordinates, strict=True))
    found: list[Variable] = []
    for prefix, per, meaning in (
        ("q", "", "position"),
        ("dq", "/s", "velocity"),
        ("ddq", "/s2", "acceleration"),
    ):
        for k, (plain, name, joint) in enumerate(joints):
            start = float(reference[k]) if prefix == "q" else 0.0
            unit = joint.unit + per
            found.append(Variable(f"{prefix}_{plain}", unit, start, f"{meaning} of joint {name}"))
    for plain, name, joint in joints:
        unit = "N" if joint.kind == "prismatic" else "N.m"
        found.append(Variable(f"tau_{plain}", unit, None, f"effort of joint {name}"))
    if robot.passive:
        meaning = "largest distance of two points that close a chain"
        found.append(Variable("closure_error", "m", None, meaning))
    return found


def model_description(code: CCode, guid: str) -> str:
    """The content of `modelDescription.xml`."""
    variables = variables_of(code)
    rows = []
    for k, v in enumerate(variables):
        causality = "output" if v.start is None else "input"
        start = "" if v.start is None else f' start="{v.start!r}"'
        rows.append(
            f'    <ScalarVariable name={quoteattr(v.name)} valueReference="{k}" '
            f'causality="{causality}" variability="continuous" '
            f"description={quoteattr(v.meaning)}>"
            f'<Real unit="{v.unit}"{start}/></ScalarVariable>'
        )
    outputs = [k + 1 for k, v in enumerate(variables) if v.start is None]
    unknowns = "\n".join(f'      <Unknown index="{k}"/>' for k in outputs)
    units = "\n".join(
        f'    <Unit name="{unit}">{base}</Unit>'
        for unit, base in FMI_UNITS.items()
        if any(v.unit == unit for v in variables)
    )
    name = code.controller.model.robot.name
    files = "".join(f'<File name="{x}"/>' for x in (f"{code.name}.c", f"{code.name}_fmi2.c"))
    return f"""\
<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName={quoteattr(name)} guid="{guid}"
    description="Joint efforts of an identified robot" generationTool="steelyard"
    variableNamingConvention="flat" numberOfEventIndicators="0">
  <CoSimulation modelIdentifier="{code.name}" canHandleVariableCommunicationStepSize="true">
    <SourceFiles>{files}</SourceFiles>
  </CoSimulation>
  <UnitDefinitions>
{units}
  </UnitDefinitions>
  <ModelVariables>
{chr(10).join(rows)}
  </ModelVariables>
  <ModelStructure>
    <Outputs>
{unknowns}
    </Outputs>
    <InitialUnknowns>
{unknowns}
    </InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def write_fmu(code: CCode, path: Path) -> tuple[str, ...]:
    """Write the FMU, with a binary if there is a compiler; the names of its files."""
    source = code.source()
    guid = "{" + hashlib.sha256(source.encode()).hexdigest()[:32] + "}"
    starts = [v.start for v in variables_of(code) if v.start is not None]
    sources = {
        f"{code.name}.h": code.header(),
        f"{code.name}.c": source,
        f"{code.name}_fmi2.c": fmi2_code(code, guid, starts),
    }
    files = {f"sources/{name}": text.encode() for name, text in sources.items()}
    files["modelDescription.xml"] = model_description(code, guid).encode()
    files |= _binary(code.name, sources)
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:
        for name in sorted(files):
            # a fixed date: the same model is the same file
            archive.writestr(ZipInfo(name, (1980, 1, 1, 0, 0, 0)), files[name], ZIP_DEFLATED)
    return tuple(sorted(files))


def compiler() -> str | None:
    """A C compiler on the search path."""
    return next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)


def _binary(name: str, sources: dict[str, str]) -> dict[str, bytes]:
    """The shared library for this platform by its place in the FMU; none without a compiler."""
    known = PLATFORMS.get((platform.system(), platform.machine()))
    found = compiler()
    if known is None or found is None:
        return {}
    folder, suffix = known
    with tempfile.TemporaryDirectory() as place:
        for file, text in sources.items():
            (Path(place) / file).write_text(text, encoding="utf-8")
        _compile(found, Path(place), [x for x in sources if x.endswith(".c")], name + suffix)
        return {f"binaries/{folder}/{name}{suffix}": (Path(place) / (name + suffix)).read_bytes()}


def _compile(command: str, folder: Path, sources: Sequence[str], target: str) -> None:
    options = ("-std=c99", "-O2", "-shared", "-fPIC")
    done = subprocess.run(
        [command, *options, *sources, "-o", target, "-lm"], cwd=folder, capture_output=True
    )
    if done.returncode:
        raise OutputError(
            f"the compiler fails: {done.stderr.decode(errors='replace')[:200]}",
            where=command,
            fix="check that it compiles C, or take it off the search path: the FMU then has the "
            "sources alone",
        )


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

NOTHING_TO_DO = (
    ("SetDebugLogging", "fmi2Boolean on, size_t count, const fmi2String categories[]"),
    (
        "SetupExperiment",
        "fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real start, "
        "fmi2Boolean stopDefined, fmi2Real stop",
    ),
    ("EnterInitializationMode", ""),
    ("Terminate", ""),
)
"""Functions that change nothing of these models, and their arguments beside the component."""

NOT_OFFERED = (
    ("GetFMUstate", "fmi2FMUstate *state"),
    ("SetFMUstate", "fmi2FMUstate state"),
    ("FreeFMUstate", "fmi2FMUstate *state"),
    ("SerializedFMUstateSize", "fmi2FMUstate state, size_t *size"),
    ("SerializeFMUstate", "fmi2FMUstate state, fmi2Byte bytes[], size_t size"),
    ("DeSerializeFMUstate", "const fmi2Byte bytes[], size_t size, fmi2FMUstate *state"),
    (
        "GetDirectionalDerivative",
        "const fmi2ValueReference unknown[], size_t nUnknown, "
        "const fmi2ValueReference known[], size_t nKnown, const fmi2Real seed[], fmi2Real values[]",
    ),
    (
        "SetRealInputDerivatives",
        "const fmi2ValueReference vr[], size_t count, const fmi2Integer order[], "
        "const fmi2Real values[]",
    ),
    (
        "GetRealOutputDerivatives",
        "const fmi2ValueReference vr[], size_t count, const fmi2Integer order[], fmi2Real values[]",
    ),
    ("CancelStep", ""),
    ("GetStatus", "const fmi2StatusKind kind, fmi2Status *value"),
    ("GetRealStatus", "const fmi2StatusKind kind, fmi2Real *value"),
    ("GetIntegerStatus", "const fmi2StatusKind kind, fmi2Integer *value"),
    ("GetBooleanStatus", "const fmi2StatusKind kind, fmi2Boolean *value"),
    ("GetStringStatus", "const fmi2StatusKind kind, fmi2String *value"),
)
"""Functions of the interface that the model description does not offer, likewise."""


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

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{{
    return evaluate((Instance *)c);
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

{_other_types()}{_without_effect(NOTHING_TO_DO, "fmi2OK")}
{_without_effect(NOT_OFFERED, "fmi2Error")}"""


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


def _without_effect(functions: Sequence[tuple[str, str]], status: str) -> str:
    """Functions by name and arguments that return a status and do nothing else."""
    parts = []
    for name, more in functions:
        arguments = f"fmi2Component c, {more}".removesuffix(", ")
        unread = ", ".join(f"(void){x.split()[-1].strip('*[]')}" for x in arguments.split(","))
        parts.append(
            f"EXPORT fmi2Status fmi2{name}({arguments})\n"
            f"{{\n    {unread};\n    return {status};\n}}\n"
        )
    return "\n".join(parts)
