"""C functions that go from sample to sample: closed chains, and friction with memory."""

from steelyard.model.equations.passive_joints import ITERATIONS
from steelyard.robot.loop_closures import loop_equations
from steelyard.robot.robot import Robot
from steelyard.symbolic.source_code import Precision, c_literal

CLOSING_STEPS = 64
"""Steps from the reference configuration of closed chains to other positions."""

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
