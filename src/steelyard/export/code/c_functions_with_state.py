"""C functions that go from sample to sample: closed chains, memory, the observer of efforts."""

import numpy as np

from steelyard.estimate.external.contact_thresholds import HOLD, SETTLED, ContactThresholds
from steelyard.estimate.external.momentum_observer import GAP, PER_PERIOD
from steelyard.export.code.controller_functions import Controller
from steelyard.model.equations.passive_joints import ITERATIONS
from steelyard.robot.loop_closures import loop_equations
from steelyard.robot.robot import Robot
from steelyard.symbolic.source_code import Precision, c_literal

CLOSING_STEPS = 64  # steps from the reference configuration of closed chains to other positions

CLOSING_TOLERANCE = {"double": 1e-8, "float": 1e-4}
"""A last Newton step [rad; m]: the error after it is of the order of its square."""


def closing_code(name: str, real: Precision, robot: Robot) -> tuple[str, str]:
    """Functions that close the chains of a robot: declarations and definitions; none of a tree."""
    n, p, loops = robot.n, len(robot.passive), len(robot.loops)
    if not p:
        return "", ""
    arguments = f"(const {real} q[{n}], {real} passive[{p}])"
    close, follow = f"{real} {name}_close{arguments}", f"{real} {name}_follow{arguments}"
    zero, end = c_literal(0.0, real), "" if real == "double" else "f"
    steps = c_literal(float(CLOSING_STEPS), real)
    places = [f"from[{k}]" for k in range(n)] + [f"passive[{k}]" for k in range(p)]
    assigned = "\n".join(
        f"    {place} = {c_literal(float(x), real)};"
        for place, x in zip(places, loop_equations(robot).assembly, strict=True)
    )
    declared = f"""\
/*
 * Positions of the passive joints that close the chains at q. close begins at the given
 * passive positions, those of the sample before: Newton's method, at most {ITERATIONS} steps.
 * follow goes straight from the reference configuration to q in {CLOSING_STEPS} stretches: for the
 * first sample. Both return the closure error [m]: the largest distance of two points that
 * ought to be one; the chains are open where it is not near zero. It is NaN where an
 * argument is.
 */
{close};
{follow};
"""
    defined = f"""\
{close}
{{
    {real} nearer[{p}], gaps[{loops}], worst = {zero};
    int i, k;
    for (k = 0; k < {ITERATIONS}; ++k) {{
        {real} moved = {zero};
        {name}_newton(q, passive, nearer, gaps);
        for (i = 0; i < {p}; ++i) {{
            const {real} step = fabs{end}(nearer[i] - passive[i]);
            moved = step <= moved ? moved : step;
            passive[i] = nearer[i];
        }}
        if (moved < {c_literal(CLOSING_TOLERANCE[real], real)}) {{
            break;
        }}
    }}
    {name}_newton(q, passive, nearer, gaps);
    for (i = 0; i < {loops}; ++i) {{
        worst = gaps[i] <= worst ? worst : gaps[i];
    }}
    return sqrt{end}(worst);
}}

{follow}
{{
    {real} from[{n}], here[{n}], gap = {zero};
    int i, k;
{assigned}
    for (k = 1; k <= {CLOSING_STEPS}; ++k) {{
        for (i = 0; i < {n}; ++i) {{
            here[i] = from[i] + ({real})k / {steps} * (q[i] - from[i]);
        }}
        gap = {name}_close(here, passive);
    }}
    return gap;
}}
"""
    return declared, defined


def memory_code(name: str, real: Precision, robot: Robot, memory: int) -> tuple[str, str]:
    """Functions of friction with memory: declarations and definitions; none without memory."""
    n, p = robot.n, len(robot.passive)
    if not memory:
        return "", ""
    q, dq, ddq = (f"const {real} {x}[{n}]" for x in ("q", "dq", "ddq"))
    result = real if p else "void"
    start = f"{result} {name}_start({name}_state *state, {q}, {dq})"
    step = f"{result} {name}_step({name}_state *state, {q}, {dq}, {ddq}, {real} tau[{n}])"
    begun = passive = nearer = stored = back = of_passive = gap = ""
    copied = "    int i;\n"
    if p:
        gap = """\
 * Both return the closure error of the chains, see close; where it is NaN, step keeps the state.
"""
        of_passive = f"    {real} passive[{p}];\n"
        begun = f"    const {real} gap = {name}_follow(q, state->passive);\n"
        passive, nearer, back = "state->passive, ", "passive, ", "    return gap;\n"
        copied = f"""    {real} passive[{p}], gap;
    int i;
    for (i = 0; i < {p}; ++i) {{
        passive[i] = state->passive[i];
    }}
    gap = {name}_close(q, passive);
"""
        stored = f"""    if (gap != gap) {{
        return gap;
    }}
    for (i = 0; i < {p}; ++i) {{
        state->passive[i] = passive[i];
    }}
"""
    declared = f"""\
/*
 * Efforts of the whole model [Nm; N], whose friction remembers the motion. Call start with the
 * first sample of a motion, then step with every sample, the first one included. A motion
 * that begins at some speed is taken to have had it before. The state belongs to the caller;
 * several may exist.
{gap} */
typedef struct {{
{of_passive}    {real} memory[{memory}];
}} {name}_state;

{start};
{step};
"""
    defined = f"""\
{start}
{{
{begun}    {name}_begun(q, {passive}dq, state->memory);
{back}}}

{step}
{{
    {real} after[{memory}];
{copied}    {name}_stepped(q, {nearer}dq, ddq, state->memory, tau, after);
{stored}    for (i = 0; i < {memory}; ++i) {{
        state->memory[i] = after[i];
    }}
{back}}}
"""
    return declared, defined


NO_THRESHOLD = 1e30  # threshold of a joint that has none [Nm; N]


def observer_code(name: str, real: Precision, controller: Controller) -> tuple[str, str]:
    """Functions of the observer: declarations and definitions; none where it is not wanted.

    Numbers are of the type `real`, times of type `double`.
    """
    numbers, robot = controller.observer, controller.model.robot
    if numbers is None:
        return "", ""
    n, p, m = robot.n, len(robot.passive), controller.n_memory
    arrays = ", ".join(f"const {real} {x}[{n}]" for x in ("q", "dq", "tau"))
    start = f"void {name}_observer_start({name}_observer *observer, double bandwidth)"
    step = (
        f"int {name}_observer_step({name}_observer *observer, double time, {arrays}, "
        f"{real} external[{n}])"
    )
    contact = f"int {name}_observer_contact(const {name}_observer *observer, int joints[{n}])"
    usual = f"{name.upper()}_OBSERVER_BANDWIDTH"
    more = f"    {real} passive[{p}];\n" if p else ""
    more += f"    {real} memory[{m}];\n" if m else ""
    gap = (
        " * Where the chains cannot close, step returns -2 and keeps all but the time.\n"
        if p
        else ""
    )
    zero = c_literal(0.0, real)
    cleared = [f"observer->{x}[k] = {zero};" for x in ("momentum", "drive", "slow", "external")]
    compared, limits, contacts = "", "", ""
    if (known := numbers.thresholds) is not None:
        more += f"    double visited[{n}][4];\n    double moved[{n}];\n    {real} limit[{n}];\n"
        compared = f"""
/*
 * Joints whose external effort exceeds its threshold at the last sample: 1 or 0 per joint. Returns
 * their number. Thresholds are those of {known.rate:.3g} false alarms per hour, for
 * the usual bandwidth.
 */
{contact};
"""
        limits = _limits(name, real, known)
        contacts = f"""
{contact}
{{
    int k, count = 0;
    for (k = 0; k < {n}; ++k) {{
        joints[k] = fabs{"f" * (real == "float")}(observer->external[k]) > observer->limit[k];
        count += joints[k];
    }}
    return count;
}}
"""
        cleared += [f"observer->visited[k][{k}] = -HUGE_VAL;" for k in range(4)]
        cleared += ["observer->moved[k] = -HUGE_VAL;"]
        cleared += [f"observer->limit[k] = {c_literal(NO_THRESHOLD, real)};"]
    declared = f"""\
/*
 * External efforts [Nm; N] by the generalised momentum: no accelerations are needed. Call start
 * with the bandwidth [Hz], usually {usual}, then step with every sample: its
 * time [s], positions, velocities and joint efforts. Samples have to come at ten times the
 * bandwidth or faster. step returns 0; 1 at the first sample and after a gap in time, where it
 * begins anew with external efforts of zero; -1 and changes nothing where time does not increase.
{gap} * The state belongs to the caller; several may exist.
 */
#define {usual} {c_literal(numbers.bandwidth)}

typedef struct {{
    double time, rate, longest;
    int started;
    {real} momentum[{n}];
    {real} drive[{n}];
    {real} slow[{n}];
    {real} external[{n}];
{more}}} {name}_observer;

{start};
{step};
{compared}"""
    lines = "".join(f"        {line}\n" for line in cleared)
    defined = f"""\
{limits}{start}
{{
    int k;
    observer->time = 0.0;
    observer->rate = {c_literal(2.0 * np.pi)} * bandwidth;
    observer->longest = {c_literal(GAP)} / ({c_literal(PER_PERIOD)} * bandwidth);
    observer->started = 0;
    for (k = 0; k < {n}; ++k) {{
{lines}    }}
}}

{step}
{{
{_step(name, real, controller)}}}
{contacts}"""
    return declared, defined


def _step(name: str, real: Precision, controller: Controller) -> str:
    """The body of the observer's step."""
    numbers, robot = controller.observer, controller.model.robot
    n, p, m = robot.n, len(robot.passive), controller.n_memory
    zero, one = (c_literal(x, real) for x in (0.0, 1.0))
    place = passive = closed = begun = after = memory = results = stored = limits = ""
    if p:
        place, passive = f"    {real} passive[{p}], gap;\n", "passive, "
        closed = f"""\
    for (k = 0; k < {p}; ++k) {{
        passive[k] = observer->passive[k];
    }}
    gap = begins ? {name}_follow(q, passive) : {name}_close(q, passive);
    if (gap != gap) {{
        return -2;
    }}
    for (k = 0; k < {p}; ++k) {{
        observer->passive[k] = passive[k];
    }}
"""
    if m:
        after, memory, results = f", after[{m}]", ", observer->memory", ", after"
        begun = f"        {name}_begun(q, {passive}dq, observer->memory);\n"
        stored = f"""\
    for (k = 0; k < {m}; ++k) {{
        observer->memory[k] = after[k];
    }}
"""
    if numbers is not None and numbers.thresholds is not None:
        limits = f"    {name}_limits(observer, time, dq);\n"
    return f"""\
    const double since = time - observer->time;
    const int begins = !observer->started || since > observer->longest;
    {real} scalars[3], momentum[{n}], drive[{n}], slow[{n}], next[{n}]{after};
{place}    int k;
    if (observer->started && !(since > 0.0)) {{
        return -1;
    }}
{closed}    scalars[0] = begins ? {one} : ({real})exp(-observer->rate * since);
    scalars[1] = begins ? {zero} : ({real})(1.0 / since);
    scalars[2] = ({real})observer->rate;
    if (begins) {{
{begun}        for (k = 0; k < {n}; ++k) {{
            observer->slow[k] = dq[k];
            observer->external[k] = {zero};
        }}
    }}
    {name}_observed(q, {passive}dq, tau, scalars, observer->momentum, observer->drive,
        observer->slow, observer->external{memory}, momentum, drive, slow, next{results});
    for (k = 0; k < {n}; ++k) {{
        observer->momentum[k] = momentum[k];
        observer->drive[k] = drive[k];
        observer->slow[k] = slow[k];
        observer->external[k] = external[k] = next[k];
    }}
{stored}    observer->time = time;
    observer->started = 1;
{limits}    return begins;
"""


def _limits(name: str, real: Precision, known: ContactThresholds) -> str:
    """Thresholds at a sample, see `ThresholdStepper`."""
    limits = np.where(np.isnan(known.limits), NO_THRESHOLD, known.limits)
    edges, rows = (
        ",\n".join(
            f"        {{{', '.join(c_literal(float(x), real) for x in row)}}}" for row in table
        )
        for table in (known.edges, limits)
    )
    n = len(limits)
    return f"""\
/* Thresholds at a sample: a joint is in the slowest range of the last {HOLD:g} s. */
static void {name}_limits({name}_observer *observer, double time, const {real} dq[{n}])
{{
    static const {real} edges[{n}][3] = {{
{edges}
    }};
    static const {real} limits[{n}][5] = {{
{rows}
    }};
    int j, range;
    for (j = 0; j < {n}; ++j) {{
        const {real} speed = fabs{"f" * (real == "float")}(dq[j]);
        const int now = (speed > edges[j][0]) + (speed > edges[j][1]) + (speed > edges[j][2]);
        observer->visited[j][now] = time;
        if (now > 0) {{
            observer->moved[j] = time;
        }}
        range = 0;
        while (range < now && !(observer->visited[j][range] >= time - {c_literal(HOLD)})) {{
            ++range;
        }}
        if (range > 0 || time - observer->moved[j] <= {c_literal(SETTLED)}) {{
            ++range;
        }}
        observer->limit[j] = limits[j][range];
    }}
}}

"""
