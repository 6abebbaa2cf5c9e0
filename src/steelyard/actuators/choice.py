"""Which parts the actuator law needs, by motion that is left out of the fit."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.actuators.actuator_parameters import BY_NAME, ActuatorValues, Free, free_parameters
from steelyard.actuators.closed_loop_step import ArmStep
from steelyard.actuators.fit import Fitted, Task, fit, residuals, scales
from steelyard.actuators.rollout import rollouts
from steelyard.actuators.target_runs import Window
from steelyard.base.arrays import Array

ALWAYS = ("stiffness", "damping", "armature", "offset", "zero")
USUAL = ("coulomb", "delay")
POSSIBLE = ("load_friction", "torque_limit", "dead_band")
LEAST_GAIN = 0.03  # share of the left-out error that a part which is added has to take away
LEAST_LOSS = 0.005  # share that it has to grow by without a part that is kept
LEFT_OUT = 4  # every one of so many blocks of windows is left out
SHORT = 5  # rounds of a fit that begins at another one
REACH = 0.8  # of the largest torque: where a limit is tried first


@dataclass(frozen=True)
class Rung:
    """A law that was tried: its parts, and its error on left-out motion.

    Attributes:
        parts: Parameters that are searched.
        tried: The part in question, with a sign: `+ dead_band`, `- delay`.
        error: Geometric mean over the joints of the scale of left-out residuals [rad; m].
        kept: Whether the law goes on with it.
    """

    parts: tuple[str, ...]
    tried: str
    error: float
    kept: bool

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {"tried": self.tried, "error": self.error, "kept": self.kept}


@dataclass(frozen=True, eq=False)
class Search:
    """What laws are tried on."""

    step: ArmStep
    windows: tuple[Window, ...]
    joints: Mapping[str, Sequence[int]]
    """Joints at which a parameter is searched, where that is not all of them."""
    zeros: Mapping[int, tuple[float, float]]
    """Prior of the zeros that are searched, see `zero_prior`."""
    h: float
    threads: int

    def free(self, parts: Sequence[str]) -> tuple[Free, ...]:
        """What is searched of these parts."""
        return free_parameters(parts, self.joints, self.step.n)

    def task(self, windows: Sequence[Window], parts: Sequence[str], start: ActuatorValues) -> Task:
        """To fit these parts."""
        free = self.free(parts)
        return Task.of(self.step, windows, free, start, self.zeros, self.h, self.threads)


def split(windows: Sequence[Window]) -> tuple[list[Window], list[Window]]:
    """Windows that are fitted, and those left out: stretches of several windows of every log."""
    block = 3
    names = list(dict.fromkeys(w.run.name for w in windows))
    fitted, left = list[Window](), list[Window]()
    for number, name in enumerate(names):
        mine = [w for w in windows if w.run.name == name]
        for k, window in enumerate(mine):
            out = (k // block + number) % LEFT_OUT == LEFT_OUT - 1
            (left if out else fitted).append(window)
    if not left and len(fitted) > 1:
        left = [fitted.pop()]
    return fitted, left


def left_out_error(search: Search, values: ActuatorValues, left: Sequence[Window]) -> float:
    """Geometric mean over the joints of the scale of residuals."""
    rolled = rollouts(search.step, values, left, (), search.h, search.threads)
    task = search.task(left, (), values)
    scale = scales(residuals(task, rolled))
    return float(np.exp(np.log(scale).mean()))


def with_part(values: ActuatorValues, part: str, windows: Sequence[Window]) -> ActuatorValues:
    """Values with a first one of a part that they lack."""
    first: dict[str, Any] = {
        "load_friction": 0.05,
        "torque_limit": REACH * largest_torque(windows, values),
        "dead_band": 0.2 * values["coulomb"] / values["stiffness"] + 1e-4,
    }
    return values.changed(**{part: first[part]})


def with_stated(
    values: ActuatorValues, stated: Mapping[str, Array], windows: Sequence[Window]
) -> ActuatorValues:
    """Values as they are stated; NaN are those that are to be identified, and begin somewhere."""
    for part, given in stated.items():
        first = with_part(values, part, windows) if part in POSSIBLE else values
        values = values.changed(**{part: np.where(np.isnan(given), first[part], given)})
    return values


def largest_torque(windows: Sequence[Window], values: ActuatorValues) -> Array:
    """Of the springs of the controllers along the logs, but for the rarest, `(n,)`."""
    error = np.concatenate([w.run.target[w.start : w.stop] - w.q for w in windows])
    return np.asarray(values["stiffness"] * np.quantile(np.abs(error), 0.995, axis=0) + 1e-6)


def chosen(
    search: Search,
    start: ActuatorValues,
    stated: Mapping[str, Array],
    automatic: bool,
    progress: Callable[[str], None] = lambda what: None,
) -> tuple[Fitted, tuple[Rung, ...], tuple[str, ...]]:
    """The law that predicts left-out motion best, its fit without that motion, and what was tried.

    A part that the user states is in the law in any case; no other one is tried unless the choice
    is `automatic`.
    """
    fitted, left = split(search.windows)
    begin = with_stated(start, stated, fitted)
    usual = [*ALWAYS, *USUAL, *(p for p in POSSIBLE if p in stated)]
    parts = tuple(p for p in usual if p not in stated or np.isnan(stated[p]).any())
    progress("the usual law")
    now = fit(search.task(fitted, parts, begin), begin)
    error = left_out_error(search, now.values, left)
    rungs = [Rung(parts, "the usual law", error, True)]
    for part, adds in _questions(stated) if automatic else ():
        sign = "+" if adds else "-"
        progress(f"{sign} {part}")
        others = (*parts, part) if adds else tuple(p for p in parts if p != part)
        if adds:
            first = with_part(now.values, part, fitted)
        else:
            first = now.values.changed(**{part: BY_NAME[part].default})
        other = fit(search.task(fitted, others, first), first, SHORT)
        new = left_out_error(search, other.values, left)
        better = new < error * (1.0 - LEAST_GAIN) if adds else new <= error * (1.0 + LEAST_LOSS)
        rungs.append(Rung(others, f"{sign} {part}", new, better))
        if better:
            now, error, parts = other, new, others
    return now, tuple(rungs), parts


def _questions(stated: Mapping[str, Array]) -> Iterator[tuple[str, bool]]:
    """Parts that may be left out, then those that may be added."""
    yield from ((part, False) for part in USUAL if part not in stated)
    yield from ((part, True) for part in POSSIBLE if part not in stated)
