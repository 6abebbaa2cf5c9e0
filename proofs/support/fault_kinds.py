"""The kinds of fault, each a function of a clean log and chance."""

import re
from collections.abc import Callable

import numpy as np
from proofs.support.faults import Clean, Faulty, with_keys

from steelyard.check.all_checks import Diagnosis
from steelyard.check.cases_and_checks import (
    EffortPredictor,
    effort_predictor,
)
from steelyard.check.finding import Edit
from steelyard.robot.file.toml_edits import edited
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording

Random = np.random.Generator
Kind = Callable[[Clean, Random], Faulty | None]


def _order(n: int, rng: Random) -> list[int]:
    """Two joints exchanged, or any order."""
    order = list(range(n))
    if rng.random() < 0.5:
        a, b = rng.choice(n, 2, replace=False)
        order[a], order[b] = order[b], order[a]
        return order
    while order == list(range(n)):
        order = rng.permutation(n).tolist()
    return order


def _permuted(clean: Clean, rng: Random, which: tuple[str, ...]) -> Faulty:
    s, table = clean.signals, clean.table.copy()
    order = _order(s.n, rng)
    for names in (getattr(s, kind) for kind in which):
        if names is not None:
            at = clean.places(names)
            table[:, at] = clean.table[:, [at[k] for k in order]]
    return Faulty(clean.text, table, ("joint order",))


def positions_permuted(clean: Clean, rng: Random) -> Faulty:
    """Positions, and velocities with them, in another order than efforts."""
    return _permuted(clean, rng, ("position", "velocity"))


def efforts_permuted(clean: Clean, rng: Random) -> Faulty:
    """Efforts in another order."""
    return _permuted(clean, rng, ("effort",))


def joints_permuted(clean: Clean, rng: Random) -> Faulty:
    """Everything in another order than the model's joints."""
    return _permuted(clean, rng, ("position", "velocity", "effort"))


def position_flipped(clean: Clean, rng: Random) -> Faulty:
    """One or two joints count the other way, of those that do more than overcome friction."""
    s, table = clean.signals, clean.table.copy()
    chosen = rng.choice(np.flatnonzero(driven(clean) > 0.15), rng.integers(1, 3), replace=False)
    for names in (s.position, s.velocity or ()):
        for j in chosen if names else ():
            table[:, clean.columns.index(names[j])] *= -1.0
    return Faulty(clean.text, table, ("position sign",))


def effort_flipped(clean: Clean, rng: Random) -> Faulty:
    """One effort, or all, with the other sign; of joints that do more than overcome friction."""
    s, table = clean.signals, clean.table.copy()
    everything = rng.random() < 0.5
    chosen = range(s.n) if everything else [rng.choice(np.flatnonzero(driven(clean) > 0.15))]
    table[:, clean.places([s.effort[j] for j in chosen])] *= -1.0
    return Faulty(clean.text, table, ("effort sign",))


def sign_of_friction(clean: Clean, rng: Random) -> Faulty | None:
    """A position or an effort of the other sign where nothing but friction shows it.

    That a sign is wrong is certain, which of the two is not: it is to be doubtful, and both to be
    named.
    """
    s, table = clean.signals, clean.table.copy()
    loose = np.flatnonzero(driven(clean) <= 0.15)
    if len(loose) == 0:
        return None
    joint = int(rng.choice(loose))
    of_effort = rng.random() < 0.5
    for names in (s.effort,) if of_effort else (s.position, s.velocity):
        if names is not None:
            table[:, clean.columns.index(names[joint])] *= -1.0

    def corrected(clean: Clean, found: Diagnosis) -> bool:
        wrong = [f for f in found.findings if f.check.endswith("sign") and f.severity]
        sentences = [h.says for f in wrong for h in f.hypotheses[:2] if clean.signals.position]
        name = clean.loaded.robot.joint_names[joint]
        return (
            f"'{name}' has the opposite sign" in sentences
            and f"effort of '{name}' has the opposite sign" in sentences
        )

    return Faulty(clean.text, table, ("position sign", "effort sign"), least=1, corrected=corrected)


def degrees(clean: Clean, rng: Random) -> Faulty:
    """Positions in degrees."""
    s, table = clean.signals, clean.table.copy()
    table[:, clean.places(s.position)] *= 180.0 / np.pi
    return Faulty(clean.text, table, ("position", "velocity"))


def rpm(clean: Clean, rng: Random) -> Faulty | None:
    """Velocities in revolutions a minute."""
    s, table = clean.signals, clean.table.copy()
    if s.velocity is None:
        return None
    table[:, clean.places(s.velocity)] *= 30.0 / np.pi
    return Faulty(clean.text, table, ("velocity",))


def milli(clean: Clean, rng: Random) -> Faulty:
    """Efforts a thousand times larger: mA for A, mNm for Nm."""
    s, table = clean.signals, clean.table.copy()
    table[:, clean.places(s.effort)] *= 1e3
    return Faulty(clean.text, table, ("effort unit",))


def milliseconds(clean: Clean, rng: Random) -> Faulty:
    """Time in milliseconds."""
    table = clean.table.copy()
    table[:, clean.places([clean.signals.time])] *= 1e3
    return Faulty(clean.text, table, ("clock",))


def torque_for_current(clean: Clean, rng: Random) -> Faulty:
    """Currents declared as torques, or torques declared as currents.

    Where nobody knows the gains, they are fitted; that of a joint which only overcomes friction,
    or whose effort the reference does not predict, comes out rough.
    """
    s, table = clean.signals, clean.table.copy()
    at = clean.places(s.effort)
    if "A" not in s.effort_units:
        table[:, at] /= rng.uniform(5.0, 20.0, s.n)
        tolerance = np.where(telling(clean), 0.1, np.inf)
        return Faulty(clean.text, table, ("effort kind",), tolerance=tolerance)
    if rng.random() < 0.5:
        table[:, at] *= s.gains
        return Faulty(clean.text, table, ("effort kind",))
    text = with_keys(clean.text, kind="joint_torque", unit="Nm", gain=None)
    return Faulty(text, table, ("effort kind",))


def _knowledge(clean: Clean) -> EffortPredictor:
    found = effort_predictor(clean.reference, clean.loaded.robot)
    if found is None:
        raise ValueError("nothing is known of the robot")
    return found


def telling(clean: Clean) -> np.ndarray:
    """Joints that friction does not rule and that the reference predicts to 15 %, `(n,)`."""
    return (driven(clean) >= 0.5) & (clean.misfits < 0.15)


def driven(clean: Clean) -> np.ndarray:
    """Share of every joint's effort that bodies and rotors need, shape `(n,)`."""
    known = _knowledge(clean)
    _, q, dq, ddq = _motion(clean)
    steady = known.torque(q, dq, ddq, known.robot.gravity)
    friction = known.friction(q, dq, ddq)
    whole = np.linalg.norm(steady + friction, axis=1)
    return np.asarray(np.linalg.norm(steady, axis=1) / whole)


def _motion(clean: Clean) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Smooth motion at the log's rows: time and `q, dq, ddq`, each `(n, N)`."""
    recording = Recording(LogInMemory(clean.path, clean.columns, clean.table), clean.signals)
    data = prepare(recording, Processing()).whole()
    t = clean.table[:, clean.columns.index(clean.signals.time)] * clean.signals.time_scale
    t = t - t[0]
    m = data.motion
    return t, *(np.array([np.interp(t, m.t, column) for column in x.T]) for x in (m.q, m.dq, m.ddq))


def gravity_compensated(clean: Clean, rng: Random) -> Faulty:
    """Efforts less the gravity that the reference says."""
    s, table, known = clean.signals, clean.table.copy(), _knowledge(clean)
    _, q, _, _ = _motion(clean)
    pull = np.einsum("k,knb->nb", known.robot.gravity, known.pulls(q))
    table[:, clean.places(s.effort)] -= (pull / s.gains[:, None] / s.effort_scale[:, None]).T

    def corrected(_: Clean, found: Diagnosis) -> bool:
        values = {e.path: e.value for e in found.edits}
        kind = values.get(("signals", "effort", "kind")) == "gravity_compensated_torque"
        return kind or values.get(("robot", "gravity")) == [0.0, 0.0, 0.0]

    return Faulty(clean.text, table, ("effort kind",), corrected=corrected)


def gear_ratio(clean: Clean, rng: Random) -> Faulty:
    """One joint's effort off by a ratio of 1.4 to 3, either way.

    Of joints that do more than overcome friction, which may drift as much by itself, and whose
    effort the reference predicts.
    """
    s, table = clean.signals, clean.table.copy()
    ratio = rng.uniform(1.4, 3.0) ** rng.choice([-1.0, 1.0])
    joint = rng.choice(np.flatnonzero(telling(clean)))
    table[:, clean.columns.index(s.effort[joint])] *= ratio
    return Faulty(clean.text, table, ("gain",), tolerance=0.1 * np.ones(s.n))


def delayed(clean: Clean, rng: Random) -> Faulty:
    """Efforts logged 2 to 12 rows, and at least 5 ms, late or early, with what they were before."""
    s, table = clean.signals, clean.table.copy()
    t = table[:, clean.columns.index(s.time)]
    step = float(np.median(np.diff(t)))
    delay = 0.0
    while abs(clean.delay + delay) < max(2.0 * step, 0.005):
        delay = max(rng.uniform(2.0, 12.0) * step, 0.005) * rng.choice([-1.0, 1.0])
    for c in s.effort:
        k = clean.columns.index(c)
        table[:, k] = np.interp(t - delay, t, clean.table[:, k])

    def corrected(clean: Clean, found: Diagnosis) -> bool:
        values = {e.path: e.value for e in found.edits}
        stated = float(values.get(("signals", "effort", "delay"), 0.0))
        return abs(stated - clean.delay - delay) <= max(0.5 * step, 0.1 * abs(delay), 0.001)

    return Faulty(clean.text, table, ("effort delay",), corrected=corrected)


def jitter(clean: Clean, rng: Random) -> Faulty:
    """A clock that jitters by more than half a step."""
    table = clean.table.copy()
    k = clean.columns.index(clean.signals.time)
    step = float(np.median(np.diff(table[:, k])))
    table[:, k] = np.sort(
        table[:, k] + rng.uniform(0.7, 1.5) * step * rng.standard_normal(len(table))
    )
    return Faulty(clean.text, table, ("clock", "repeats"), least=1, corrected=lambda *_: True)


def gaps(clean: Clean, rng: Random) -> Faulty:
    """Stretches of rows that are lost."""
    table = clean.table
    keep = np.ones(len(table), dtype=bool)
    step = float(np.median(np.diff(table[:, clean.columns.index(clean.signals.time)])))
    for start in rng.uniform(0.1, 0.9, 3):
        at = int(start * len(table))
        keep[at : at + int(rng.uniform(0.15, 0.4) / step)] = False
    return Faulty(clean.text, table[keep], ("clock", "rows"), least=1, corrected=lambda *_: True)


def mounting(clean: Clean, rng: Random) -> Faulty:
    """The robot file says that gravity points elsewhere."""
    own = clean.loaded.robot.gravity
    while True:
        if rng.random() < 0.5:
            wrong = np.eye(3)[rng.integers(3)] * rng.choice([-9.81, 9.81])
        else:
            wrong = rng.standard_normal(3)
            wrong = 9.81 * wrong / np.linalg.norm(wrong)
        if wrong @ own < 0.9 * 9.81**2:
            break
    edit = Edit(("robot", "gravity"), [round(float(x), 4) + 0.0 for x in wrong])
    return Faulty(edited(clean.text, [edit]), clean.table, ("mounting",))


def payload(clean: Clean, rng: Random) -> Faulty:
    """2 to 5 kg at the last link that nobody spoke of."""
    s, table, known = clean.signals, clean.table.copy(), _knowledge(clean)
    mass = rng.uniform(2.0, 5.0)
    com = rng.uniform(-0.08, 0.08, 3) + [0.0, 0.0, 0.08]
    ten = Inertia.about_com(mass, com, np.eye(3) * 0.0025 * mass).ten
    _, q, dq, ddq = _motion(clean)
    torque = np.einsum("k,knb->nb", ten, known.payload(q, dq, ddq, known.robot.gravity))
    table[:, clean.places(s.effort)] += (torque / s.gains[:, None] / s.effort_scale[:, None]).T
    return Faulty(clean.text, table, ("payload",), corrected=_weighed(mass))


def _weighed(mass: float) -> Callable[[Clean, Diagnosis], bool]:
    """Whether the payload's mass is reported within 10 %, and no edit is made."""

    def corrected(_: Clean, found: Diagnosis) -> bool:
        payloads = [f for f in found.findings if f.check == "payload"]
        masses = (
            [float(kg) for kg in re.findall(r"([\d.]+) kg", payloads[0].says)] if payloads else []
        )
        return bool(masses) and abs(masses[0] - mass) <= 0.1 * mass and not found.edits

    return corrected


def real_payload(mass: float) -> Kind:
    """A log of a robot that carried something."""

    def faulty(clean: Clean, rng: Random) -> Faulty:
        seconds = clean.table[:, clean.columns.index(clean.signals.time)]
        length = rng.uniform(0.5, 0.9) * (seconds[-1] - seconds[0])
        start = seconds[0] + rng.uniform(0.0, 1.0) * (seconds[-1] - seconds[0] - length)
        inside = (seconds >= start) & (seconds <= start + length)
        return Faulty(clean.text, clean.table[inside], ("payload",), corrected=_weighed(mass))

    return faulty


KINDS: dict[str, Kind] = {
    "positions permuted": positions_permuted,
    "efforts permuted": efforts_permuted,
    "joints permuted": joints_permuted,
    "position sign": position_flipped,
    "effort sign": effort_flipped,
    "sign that only friction shows": sign_of_friction,
    "degrees": degrees,
    "rpm": rpm,
    "mA, mNm": milli,
    "ms": milliseconds,
    "torque for current": torque_for_current,
    "gravity compensated": gravity_compensated,
    "gear ratio, gain": gear_ratio,
    "delay": delayed,
    "clock jitter": jitter,
    "clock gaps": gaps,
    "wrong mounting": mounting,
    "payload": payload,
}
