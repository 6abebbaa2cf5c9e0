"""Which parts the actuator law needs, by motion that is left out of the fit."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
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
WIDE = 0.35  # standard deviation of a logarithm, above which a value is not known
LEAST_GAIN = 0.02  # share of the left-out error that a part which is added has to take away
LEAST_LOSS = 0.005  # share that it has to grow by without a part that is kept
LEFT_OUT = 4  # every one of so many blocks of windows is left out
SHORT = 5  # rounds of a fit that begins at another one
LIMITS = 7  # torque limits that are tried, from the largest torque of a spring to its median
REACH = 0.8  # of the largest torque: where a limit is tried first


@dataclass(frozen=True)
class Rung:
    """A law that was tried: its parts, and its error on left-out motion.

    Attributes:
        parts: Parameters that are searched.
        tried: The part in question, with a sign: `+ dead_band`, `- delay`.
        error: Size of left-out residuals, see `left_out_error` [rad; m].
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
    centre: ActuatorValues
    """About which the prior of all other parameters is: where the search began."""
    h: float
    threads: int

    def free(self, parts: Sequence[str]) -> tuple[Free, ...]:
        """What is searched of these parts."""
        return free_parameters(parts, self.joints, self.step.n)

    def task(self, windows: Sequence[Window], parts: Sequence[str]) -> Task:
        """To fit these parts."""
        free = self.free(parts)
        return Task.of(self.step, windows, free, self.centre, self.zeros, self.h, self.threads)


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
    """Geometric mean of scale and root mean square of residuals, and over the joints.

    The scale shows what is usual, the root mean square what is rare, such as a torque limit.
    """
    rolled = rollouts(search.step, values, left, (), search.h, search.threads)
    task = search.task(left, ())
    found = residuals(task, rolled)
    rms = np.sqrt(np.mean(np.concatenate(found) ** 2, axis=0))
    return float(np.exp(0.5 * np.log(scales(found) * np.maximum(rms, 1e-9)).mean()))


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


def largest_torque(
    windows: Sequence[Window], values: ActuatorValues, share: float = 0.995
) -> Array:
    """Of the springs of the controllers along the logs, in this share of all rows, `(n,)`."""
    error = np.concatenate([w.run.target[w.start : w.stop] - w.q for w in windows])
    return np.asarray(values["stiffness"] * np.quantile(np.abs(error), share, axis=0) + 1e-6)


def chosen(
    search: Search,
    start: ActuatorValues,
    stated: Mapping[str, Array],
    automatic: bool,
    progress: Callable[[str], None] = lambda what: None,
) -> tuple[Fitted, tuple[Rung, ...], tuple[str, ...], Search]:
    """The law that predicts left-out motion best, and its fit without that motion.

    Then what was tried, the parts of the law, and the search with the joints that have them.

    A part that the user states is in the law in any case; no other one is tried unless the choice
    is `automatic`.
    """
    fitted, left = split(search.windows)
    begin = with_stated(start, stated, fitted)
    usual = [*ALWAYS, *USUAL, *(p for p in POSSIBLE if p in stated)]
    parts = tuple(p for p in usual if p not in stated or np.isnan(stated[p]).any())
    progress("the usual law")
    first = {p: with_part(begin, p, fitted)[p] for p in POSSIBLE}
    search = replace(search, centre=search.centre.changed(**first))
    now = fit(search.task(fitted, parts), begin)
    error = left_out_error(search, now.values, left)
    rungs = [Rung(parts, "the usual law", error, True)]
    for part, adds in _questions(stated) if automatic else ():
        sign = "+" if adds else "-"
        progress(f"{sign} {part}")
        others = (*parts, part) if adds else tuple(p for p in parts if p != part)
        of, first = search, now.values.changed(**{part: BY_NAME[part].default})
        if adds:
            first = with_part(now.values, part, fitted)
        if part == "torque_limit":
            first, joints = _limited(search, now.values, fitted)
            of = replace(search, joints={**search.joints, part: joints})
            if not joints:
                rungs.append(Rung(others, f"{sign} {part}", error, False))
                continue
        other = fit(of.task(fitted, others), first, SHORT)
        new = left_out_error(search, other.values, left)
        if adds:
            better = new < error * (1.0 - LEAST_GAIN) and _shown(other, part)
        else:
            better = new <= error * (1.0 + LEAST_LOSS)
        rungs.append(Rung(others, f"{sign} {part}", new, better))
        if better:
            now, error, parts, search = other, new, others, of
    return now, tuple(rungs), parts, search


def _shown(found: Fitted, part: str) -> bool:
    """Whether the data show a part at some joint: its interval ends at half and at twice, or less.

    What only continues a fit that has not ended lowers the error too.
    """
    std = [s for one, s in zip(found.task.free, found.std, strict=True) if one.name == part]
    return bool(min(std) < WIDE)


def _limited(
    search: Search, values: ActuatorValues, windows: Sequence[Window]
) -> tuple[ActuatorValues, list[int]]:
    """Values with torque limits where one lowers the error of fitted motion, and these joints."""
    best = left_out_error(search, values, windows)
    largest, usual = (largest_torque(windows, values, share) for share in (0.995, 0.5))
    joints = []
    for j in search.joints.get("torque_limit", range(search.step.n)):
        for limit in np.geomspace(0.9 * largest[j], usual[j], LIMITS):
            limits = values["torque_limit"].copy()
            limits[j] = limit
            tried = values.changed(torque_limit=limits)
            error = left_out_error(search, tried, windows)
            if error < best * (1.0 - LEAST_LOSS):
                values, best = tried, error
                joints += [j] * (j not in joints)
    return values, joints


def _questions(stated: Mapping[str, Array]) -> Iterator[tuple[str, bool]]:
    """Parts that may be left out, then those that may be added."""
    yield from ((part, False) for part in USUAL if part not in stated)
    yield from ((part, True) for part in POSSIBLE if part not in stated)
