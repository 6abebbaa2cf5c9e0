"""A model as one Python file that needs NumPy alone."""

import numpy as np

from steelyard.estimate.external.contact_thresholds import HOLD, SETTLED, ContactThresholds
from steelyard.estimate.external.momentum_observer import GAP, PER_PERIOD
from steelyard.export.code.c_functions_with_state import CLOSING_STEPS, CLOSING_TOLERANCE
from steelyard.export.code.c_header_and_source import commented, joint_lines, named_functions
from steelyard.export.code.controller_functions import Controller, Function, ObserverNumbers
from steelyard.model.equations.passive_joints import ITERATIONS
from steelyard.robot.loop_closures import loop_equations
from steelyard.symbolic.source_code import Syntax, source_of

SYNTAX = Syntax(
    {
        "add": "{0} + {1}",
        "sub": "{0} - {1}",
        "mul": "{0} * {1}",
        "div": "{0} / {1}",
        "neg": "-{0}",
        "less": "1.0 * ({0} < {1})",
        "less_equal": "1.0 * ({0} <= {1})",
        "minimum": "np.minimum({0}, {1})",
        "maximum": "np.maximum({0}, {1})",
        "atan": "np.arctan({0})",
        **{name: f"np.{name}({{0}})" for name in ("sqrt", "abs", "sign", "sin", "cos", "exp")},
        "tanh": "np.tanh({0})",
    },
    lambda value: repr(value) if value >= 0.0 else f"({value!r})",
    "    {0} = {1}",
)


_COLUMNS = """\
def _columns(name, values, size):
    values = np.asarray(values, dtype=float)
    if values.ndim not in (1, 2) or values.shape[-1] != size:
        raise ValueError(f"{name} of shape ({size},) or (N, {size}) expected, not {values.shape}")
    return np.moveaxis(values, -1, 0)"""
"""A function of the file: an argument as its columns."""


def python_code(controller: Controller, origin: tuple[str, ...]) -> str:
    """The file's text."""
    robot = controller.model.robot
    functions = named_functions(controller)
    laws = ", ".join(term.law for term in controller.model.terms)
    head = [
        f"Dynamics of robot '{robot.name}', written by steelyard; needs NumPy alone.",
        "",
        *origin,
        f"Terms: {laws}.",
        "Joints in the order of all arrays, units of position and effort:",
        *joint_lines(robot.coordinates),
        "",
        "Arguments are one state, shape (n,), or one a row, (N, n); results likewise.",
    ]
    parts = [
        '"""' + "\n".join(_spaced(line) for line in head).strip() + '\n"""',
        "import numpy as np",
        _COLUMNS,
        f"JOINTS = {robot.joint_names!r}",
        *(_function(name, f) for name, f in functions.items()),
    ]
    if "regressor" in functions:
        known = controller.parameters
        pairs = [f"    {n!r}: {x!r}," for n, x in known.as_dict().items()]
        parts.append("PARAMETERS = {\n" + "\n".join(pairs) + "\n}")
        parts.append('"""Base parameters in the order of the regressor\'s columns."""')
    if robot.passive:
        parts.append(_closing(controller))
    if controller.n_memory:
        parts.append(_state(controller))
    if controller.observer is not None:
        parts.append(_observer(controller, controller.observer))
    return "\n\n\n".join(parts) + "\n"


def _function(name: str, function: Function) -> str:
    arguments = [x.name for x in function.program.inputs]
    sizes = [size for _, size in function.sizes]
    places = [f"found[{k}]" for k in range(sum(sizes))]
    # zeros are there already
    lines = [
        line
        for line in source_of(function.program, places, SYNTAX)[0]
        if not (line.startswith("    found[") and line.endswith("= 0.0"))
    ]
    moved = "\n".join(
        f"    {x.name} = _columns({x.name!r}, {x.name}, {x.entries})"
        for x in function.program.inputs
    )
    results, first = [], 0
    for (_, shape), size in zip(function.outputs, sizes, strict=True):
        part = f"np.moveaxis(found[{first}:{first + size}], 0, -1)"
        if len(shape) > 1:
            part += f".reshape(*q.shape[1:], {', '.join(map(str, shape))})"
        results.append(part)
        first += size
    shapes = ", ".join(f"{x} {shape}" for x, shape in function.outputs)
    hidden = "" if function.public else "_"
    return f"""\
def {hidden}{name}({", ".join(arguments)}):
    \"\"\"{commented(function.meaning)}: {commented(shapes)}.\"\"\"
{moved}
    found = np.zeros(({sum(sizes)}, *q.shape[1:]))
{chr(10).join(lines)}
    return {", ".join(results)}"""


def _closing(controller: Controller) -> str:
    robot = controller.model.robot
    reference = loop_equations(robot).assembly
    n = robot.n
    return f"""\
def close(q, passive):
    \"\"\"Passive joints at q (n,) from those nearby, and the closure error [m].\"\"\"
    passive = np.asarray(passive, dtype=float)
    for _ in range({ITERATIONS}):
        nearer, _ = _newton(q, passive)
        moved = np.abs(nearer - passive).max()
        passive = nearer
        if moved < {CLOSING_TOLERANCE["double"]!r}:
            break
    return passive, float(np.sqrt(_newton(q, passive)[1].max()))


def follow(q):
    \"\"\"Passive joints at q (n,), from the reference configuration, and the closure error.\"\"\"
    start, passive = np.array({reference[:n].tolist()!r}), np.array({reference[n:].tolist()!r})
    for share in np.arange(1, {CLOSING_STEPS + 1}) / {CLOSING_STEPS}.0:
        passive, gap = close(start + share * (np.asarray(q, dtype=float) - start), passive)
    return passive, gap"""


def _state(controller: Controller) -> str:
    closed = bool(controller.model.robot.passive)
    passive = "self.passive, " if closed else ""
    followed = nearer = ""
    if closed:
        followed = "        self.passive, self.gap = follow(q)\n"
        nearer = """\
        passive, self.gap = close(q, self.passive)
        if self.gap != self.gap:
            return np.full(len(JOINTS), np.nan)
        self.passive = passive
"""
    return f"""\
class State:
    \"\"\"Efforts of the whole model [Nm; N] at consecutive samples: friction remembers the motion.

    Start with the first sample, then step with every sample, the first one included.
    \"\"\"

    def __init__(self, q, dq):
{followed}        self.memory = _begun(q, {passive}dq)

    def step(self, q, dq, ddq):
        \"\"\"Efforts at the next sample, shape (n,).\"\"\"
{nearer}        tau, self.memory = _stepped(q, {passive}dq, ddq, self.memory)
        return tau"""


def _observer(controller: Controller, numbers: ObserverNumbers) -> str:
    robot, known = controller.model.robot, numbers.thresholds
    passive = "self.passive, " if robot.passive else ""
    followed = ""
    if robot.passive:
        followed = """\
        passive, gap = follow(q) if begins else close(q, self.passive)
        if gap != gap:
            raise ValueError("the chains cannot close at these positions")
        self.passive = passive
"""
    begun = f"            self.memory = _begun(q, {passive}dq)\n" if controller.n_memory else ""
    memory = ", self.memory" if controller.n_memory else ""
    contact = "" if known is None else _contact(known)
    started = "" if known is None else STARTED_THRESHOLDS
    ranged = "" if known is None else "        self._compare(time, dq)\n"
    return f"""\
class Observer:
    \"\"\"External efforts [Nm; N] at consecutive samples, by the generalised momentum.

    Samples have to come at ten times the bandwidth [Hz] or faster. `torque` has the efforts at the
    last sample, shape (n,); at the first sample and after a gap in time they are zero.
    \"\"\"

    def __init__(self, bandwidth={numbers.bandwidth!r}):
        self.rate = {2.0 * np.pi!r} * bandwidth
        self.longest = {GAP!r} / ({PER_PERIOD!r} * bandwidth)
        self.time = -np.inf
        self.torque = np.zeros(len(JOINTS))
        self.momentum = self.drive = self.slow = self.torque
{started}
    def step(self, time, q, dq, tau):
        \"\"\"Take the next sample: time [s], positions, velocities, joint efforts (n,).\"\"\"
        q, dq, tau = (np.asarray(x, dtype=float) for x in (q, dq, tau))
        since = time - self.time
        if not since > 0.0:
            raise ValueError("time does not increase")
        begins = since > self.longest
{followed}        if begins:
            scalars = np.array([1.0, 0.0, self.rate])
            self.slow, self.torque = dq, np.zeros(len(JOINTS))
{begun}        else:
            scalars = np.array([np.exp(-self.rate * since), 1.0 / since, self.rate])
        {_OBSERVED}{", self.memory" if controller.n_memory else ""} = _observed(
            q, {passive}dq, tau, scalars, {_OBSERVED}{memory}
        )
        self.time = time
{ranged}{contact}"""


_OBSERVED = "self.momentum, self.drive, self.slow, self.torque"
STARTED_THRESHOLDS = """\
        self.visited = np.full((len(JOINTS), 4), -np.inf)
        self.moved = np.full(len(JOINTS), -np.inf)
        self.limit = np.full(len(JOINTS), np.nan)
"""
"""What thresholds add to an observer."""


def _contact(known: ContactThresholds) -> str:
    """Comparison with thresholds, see `ThresholdStepper`."""
    limits = [[None if x != x else x for x in row] for row in known.limits.tolist()]
    return f"""
    EDGES = np.array({known.edges.tolist()!r})
    LIMITS = np.array({limits!r}, dtype=float)

    @property
    def contact(self):
        \"\"\"Whether each joint's external effort exceeds its threshold, shape (n,).\"\"\"
        return np.abs(self.torque) > self.limit

    def _compare(self, time, dq):
        joints = np.arange(len(JOINTS))
        now = np.sum(np.abs(dq)[:, None] > self.EDGES, axis=1)
        self.visited[joints, now] = time
        self.moved[now > 0] = time
        held = np.argmax(self.visited >= time - {HOLD!r}, axis=1)
        held = held + ((held > 0) | (time - self.moved <= {SETTLED!r}))
        self.limit = self.LIMITS[joints, held]"""


def _spaced(line: str) -> str:
    return " " * (len(line) - len(line.lstrip())) + commented(line)
