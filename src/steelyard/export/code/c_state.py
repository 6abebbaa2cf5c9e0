"""C functions that go from sample to sample: closed chains, and friction with memory."""

from dataclasses import dataclass

from steelyard.export.code.functions import Controller
from steelyard.model.equations.passive_joints import ITERATIONS
from steelyard.robot.loop_closures import loop_equations
from steelyard.symbolic.source_code import Precision, c_literal

CLOSING_STEPS = 64
"""Steps from the reference configuration of closed chains to other positions."""

CLOSING_TOLERANCE = {"double": 1e-8, "float": 1e-4}
"""A last Newton step [rad; m]: the error after it is of the order of its square."""


CLOSURE_ERROR_COMMENT = """\
 * Both return the closure error of the chains, see close; where it is NaN, step keeps the state.
"""
"""What start and step return for closed chains."""


@dataclass(frozen=True, eq=False)
class StateCode:
    """Texts of these functions, empty where the robot needs none.

    Attributes:
        name: Prefix of all names.
        precision: Type of all numbers.
        controller: The model.
    """

    name: str
    precision: Precision
    controller: Controller

    @property
    def n(self) -> int:
        """Independent joints."""
        return self.controller.model.robot.n

    @property
    def passive(self) -> int:
        """Passive joints."""
        return len(self.controller.model.robot.passive)

    @property
    def memory(self) -> int:
        """Entries of the memory of friction."""
        return self.controller.n_memory

    def declarations(self) -> list[str]:
        """For the header."""
        return [*self._closing_declared(), *self._state_declared()]

    def definitions(self) -> list[str]:
        """For the source."""
        return [*self._closing_defined(), *self._state_defined()]

    def _closing_signatures(self) -> tuple[str, str]:
        real, q = self.precision, f"const {self.precision} q[{self.n}]"
        arguments = f"({q}, {real} passive[{self.passive}])"
        return f"{real} {self.name}_close{arguments}", f"{real} {self.name}_follow{arguments}"

    def _closing_declared(self) -> list[str]:
        if not self.passive:
            return []
        close, follow = self._closing_signatures()
        return [
            f"""\
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
        ]

    def _closing_defined(self) -> list[str]:
        if not self.passive:
            return []
        name, real, n, p = self.name, self.precision, self.n, self.passive
        loops, end = len(self.controller.model.robot.loops), "" if real == "double" else "f"
        close, follow = self._closing_signatures()
        zero, reference = self._number(0.0), loop_equations(self.controller.model.robot).assembly
        places = [f"from[{k}]" for k in range(n)] + [f"passive[{k}]" for k in range(p)]
        assigned = "\n".join(
            f"    {place} = {self._number(x)};" for place, x in zip(places, reference, strict=True)
        )
        return [
            f"""\
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
        if (moved < {self._number(CLOSING_TOLERANCE[real])}) {{
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
            here[i] = from[i] + ({real})k / {self._number(CLOSING_STEPS)} * (q[i] - from[i]);
        }}
        gap = {name}_close(here, passive);
    }}
    return gap;
}}
"""
        ]

    def _state_signatures(self) -> tuple[str, str]:
        name, real, n = self.name, self.precision, self.n
        q, dq, ddq = (f"const {real} {x}[{n}]" for x in ("q", "dq", "ddq"))
        result = real if self.passive else "void"
        return (
            f"{result} {name}_start({name}_state *state, {q}, {dq})",
            f"{result} {name}_step({name}_state *state, {q}, {dq}, {ddq}, {real} tau[{n}])",
        )

    def _state_declared(self) -> list[str]:
        if not self.memory:
            return []
        start, step = self._state_signatures()
        passive = f"    {self.precision} passive[{self.passive}];\n" if self.passive else ""
        gap = CLOSURE_ERROR_COMMENT if self.passive else ""
        return [
            f"""\
/*
 * Efforts of the whole model [Nm; N], whose friction remembers the motion. Call start with the
 * first sample of a motion, then step with every sample, the first one included. A motion
 * that begins at some speed is taken to have had it before. The state belongs to the caller;
 * several may exist.
{gap} */
typedef struct {{
{passive}    {self.precision} memory[{self.memory}];
}} {self.name}_state;

{start};
{step};
"""
        ]

    def _state_defined(self) -> list[str]:
        if not self.memory:
            return []
        name, real, m = self.name, self.precision, self.memory
        start, step = self._state_signatures()
        passive = "state->passive, " if self.passive else ""
        followed = ""
        if self.passive:
            followed = f"    const {real} gap = {name}_follow(q, state->passive);\n"
        back = "    return gap;\n" if self.passive else ""
        copied, stored, nearer = "    int i;\n", "", ""
        if self.passive:
            nearer = "passive, "
            copied = f"""    {real} passive[{self.passive}], gap;
    int i;
    for (i = 0; i < {self.passive}; ++i) {{
        passive[i] = state->passive[i];
    }}
    gap = {name}_close(q, passive);
"""
            stored = f"""    if (gap != gap) {{
        return gap;
    }}
    for (i = 0; i < {self.passive}; ++i) {{
        state->passive[i] = passive[i];
    }}
"""
        return [
            f"""\
{start}
{{
{followed}    {name}_begun(q, {passive}dq, state->memory);
{back}}}

{step}
{{
    {real} after[{m}];
{copied}    {name}_stepped(q, {nearer}dq, ddq, state->memory, tau, after);
{stored}    for (i = 0; i < {m}; ++i) {{
        state->memory[i] = after[i];
    }}
{back}}}
"""
        ]

    def _number(self, value: float) -> str:
        return c_literal(float(value), self.precision)
