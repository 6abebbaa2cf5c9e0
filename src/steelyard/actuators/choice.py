"""Which parts the actuator law needs, by motion that is left out of the fit."""

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from steelyard.actuators.actuator_parameters import (
    BY_NAME,
    KINDS,
    UNLIMITED,
    ActuatorValues,
    Free,
    free_parameters,
)
from steelyard.actuators.closed_loop_step import ArmStep
from steelyard.actuators.fit import FREEDOM, Fitted, Task, fit, residuals, scales
from steelyard.actuators.rollout import rollouts
from steelyard.actuators.target_runs import Window
from steelyard.base.arrays import Array

ALWAYS = ("stiffness", "damping", "armature", "offset", "zero")
USUAL = ("coulomb", "delay")
POSSIBLE = (
    *("integral", "delays", "stribeck", "load_friction", "torque_limit", "back_emf", "dead_band"),
)
LIMIT = "torque_limit"
SATURATION = (LIMIT, "back_emf")
FIRST = ("integral", *SATURATION)
"""Parts without which all else looks different: they are tried first."""
ASKED = ("mass_factor",)
"""Parts that are searched if the user says so."""
REPLACED = {"delays": "delay"}
"""Parts that others take the place of."""
NEEDED = {"delays": "delay"}
"""Parts without which others are not tried."""
WIDE = 0.35  # standard deviation of a logarithm, above which a value is not known
NEEDED_NATS = 8.0
"""Log-likelihood of left-out motion that a part of the law has to gain."""
MOST_NATS = 20.0  # that one window gains or loses
APART = 1e-3  # between delays of joints that have one each [s]: steps of rollouts move them by less
LEAST_LOSS = 0.005  # share of the error by which a torque limit has to lower it
MANY_LOGS = 8  # from which on whole ones are left out
LEFT_OUT = 4  # every one of so many blocks of windows is left out
SHORT = 5  # rounds of a fit that begins at another one
HOPELESS = 2.0  # times the least error, from which on a part, or a lower limit, is not tried
LIMITS = 14  # torque limits that are tried, from the largest torque of a controller to its median
SLOW_RATE, FIRST_RATE = 0.1, 1.0
"""Of an integral gain over the stiffness [1/s]: below all that are of use, and where it begins."""
NONE, SHARES, FAST = (0.0,), (0.1, 0.25, 0.5), 0.9
"""Shares of the damping that are tried beside a torque limit; of all rows that are slower."""
NEAR_SHARES, NEAR_LIMITS = (1.0, 0.7, 1.4), np.linspace(-1.5, 1.5, 7)
"""Factors on the best share, and steps of limits about the best one, that are tried then."""
REACH, LARGEST = 0.8, 0.9995  # of the largest torque: where a limit is tried first; of all rows


@dataclass(frozen=True)
class Rung:
    """A law that was tried: its parts, and its error on left-out motion.

    Attributes:
        parts: Parameters that are searched.
        tried: The part in question, with a sign: `+ dead_band`, `- delay`.
        error: Size of left-out residuals, see `size` [rad; m].
        gain: Log-likelihood of left-out motion that the part gains [nats].
        kept: Whether the law goes on with it.
    """

    parts: tuple[str, ...]
    tried: str
    error: float
    gain: float
    kept: bool

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {k: x for k, x in vars(self).items() if k != "parts"}


@dataclass(frozen=True, eq=False)
class Search:
    """What laws are tried on."""

    step: ArmStep
    windows: tuple[Window, ...]
    joints: Mapping[str, Sequence[int]]
    """Joints at which a parameter is searched, where that is not all of them."""
    known: Mapping[tuple[str, int], tuple[float, float]]
    """Means and spreads of the prior of some parameters, by name and joint."""
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
        return Task.of(self.step, windows, free, self.centre, self.known, self.h, self.threads)


def split(windows: Sequence[Window], misfit: Array) -> tuple[list[Window], list[Window]]:
    """Windows that are fitted, and those left out: whole logs, or stretches of a few.

    Of the stretches that fit a joint worst by `misfit`, `(W, n)`, both have some: what a law lacks,
    such as a torque limit, may be seen in few of them.
    """
    seconds: dict[str, float] = {}
    for w in windows:
        seconds[w.run.name] = seconds.get(w.run.name, 0.0) + float(w.t[-1] - w.t[0])
    names, fitted, left = list(seconds), list[Window](), list[Window]()
    if len(names) >= MANY_LOGS and max(seconds.values()) < 0.5 * sum(seconds.values()):
        ahead, whole = 0.0, set[str]()
        for name in names:
            ahead += seconds[name] / LEFT_OUT
            if ahead >= 0.5 * seconds[name]:
                ahead -= seconds[name]
                whole.add(name)
        for w in windows:
            (left if w.run.name in whole else fitted).append(w)
        return fitted, left
    blocks: defaultdict[int, list[tuple[float, list[Window]]]] = defaultdict(list)
    for name in names:
        mine = [k for k, w in enumerate(windows) if w.run.name == name]
        block = 3 if len(mine) >= 6 * LEFT_OUT else 1
        for at in range(0, len(mine), block):
            some = mine[at : at + block]
            worst = misfit[some].max(axis=0)
            blocks[int(worst.argmax())].append((float(worst.max()), [windows[k] for k in some]))
    for alike in blocks.values():
        for k, (_, stretch) in enumerate(sorted(alike, key=lambda one: -one[0])):
            (left if k % LEFT_OUT == 1 else fitted).extend(stretch)
    if not left and len(fitted) > 1:
        left = [fitted.pop()]
    return fitted, left


def left_out(search: Search, values: ActuatorValues, left: Sequence[Window]) -> list[Array]:
    """Residuals of windows, `(N, n)` each."""
    rolled = rollouts(search.step, values, left, (), search.h, search.threads)
    return residuals(search.task(left, ()), rolled)


def size(windows: Sequence[Array]) -> float:
    """Geometric mean of scale and root mean square of residuals, and over the joints.

    The scale shows what is usual, the root mean square what is rare, such as a torque limit.
    """
    found = np.concatenate(list(windows))
    rms = np.sqrt(np.mean(found**2, axis=0))
    return float(np.exp(0.5 * np.log(scales([found]) * np.maximum(rms, 1e-9)).mean()))


def stays_off(search: Search, values: ActuatorValues, windows: Sequence[Window]) -> bool:
    """Whether positions stay where even a slow integral would not leave them."""
    slow = values.changed(integral=SLOW_RATE * values["stiffness"])
    error, least = (size(left_out(search, x, windows)) for x in (slow, values))
    return error > HOPELESS * least


def likelihood(windows: Sequence[Array], scale: Array) -> Array:
    """Logarithm of Student's likelihood of the residuals of each window, but for constants."""
    return np.array(
        [-0.5 * (FREEDOM + 1.0) * np.log1p((r / scale) ** 2 / FREEDOM).sum() for r in windows]
    )


def first_values(values: ActuatorValues, windows: Sequence[Window]) -> dict[str, Any]:
    """Where the search begins for what a law may lack, by parameter."""
    return {
        "stribeck": 0.3 * values["coulomb"] + 1e-3,
        "stribeck_speed": 0.1,
        "load_friction": 0.05,
        "torque_limit": REACH * torque_of_rows(windows, values, (LARGEST,))[0],
        "integral": FIRST_RATE * values["stiffness"],
        "back_emf": SHARES[0] * values["damping"],
        "dead_band": 0.2 * values["coulomb"] / values["stiffness"] + 1e-4,
    }


def with_part(
    search: Search, values: ActuatorValues, part: str, windows: Sequence[Window]
) -> ActuatorValues:
    """Values with first ones of a part that they lack, without the part that it replaces."""
    names = [kind.name for kind in KINDS if kind.part == part]
    begun = _begun(search, values, names, windows)
    return without(begun, REPLACED[part]) if part in REPLACED and names else begun


def _begun(
    search: Search, values: ActuatorValues, names: Collection[str], windows: Sequence[Window]
) -> ActuatorValues:
    """Values with first ones of these parameters, at joints at which they are searched."""
    n, new = values.n, dict[str, Array]()
    for name, first in first_values(values, windows).items():
        if name in names:
            searched = np.isin(np.arange(n), list(search.joints.get(name, range(n))))
            new[name] = np.where(searched, first, values[name])
    return values.changed(**new)


def without(values: ActuatorValues, part: str) -> ActuatorValues:
    """Values of a law that lacks a part."""
    if part == "delays":
        return values.changed(delay=np.median(values["delay"]))
    return values.changed(**{kind.name: kind.default for kind in KINDS if kind.part == part})


def with_stated(
    search: Search,
    values: ActuatorValues,
    stated: Mapping[str, Array],
    windows: Sequence[Window],
) -> ActuatorValues:
    """Values as they are stated; NaN are those that are to be identified, and begin somewhere."""
    parts = {BY_NAME[name].part for name in stated}
    names = [kind.name for kind in KINDS if kind.part in parts]
    values = _begun(search, values, names, windows)
    return values.changed(
        **{name: np.where(np.isnan(x), values[name], x) for name, x in stated.items()}
    )


def torque_of_rows(
    windows: Sequence[Window], values: ActuatorValues, shares: Sequence[float]
) -> list[Array]:
    """Torque of the controllers along the logs, in these shares of all rows, `(n,)` each."""
    error = np.concatenate([w.run.target[w.start : w.stop] - w.q for w in windows])
    speed = np.concatenate([np.gradient(w.q, w.t, axis=0) for w in windows])
    wanted = np.abs(values["stiffness"] * error - values["damping"] * speed)
    return [np.quantile(wanted, share, axis=0) + 1e-6 for share in shares]


@dataclass(eq=False)
class _Choice:
    """The law so far: its fit to `fitted` windows, and what it leaves of those left out."""

    search: Search
    fitted: Sequence[Window]
    left: Sequence[Window]
    parts: tuple[str, ...]
    now: Fitted
    residuals: list[Array]
    rungs: list[Rung]

    @classmethod
    def begun(
        cls, search: Search, start: ActuatorValues, stated: Mapping[str, Array], given: set[str]
    ) -> "_Choice":
        """The usual law, with what the user states."""
        begin = with_stated(search, start, stated, search.windows)
        found = left_out(search, begin, search.windows)
        misfit = np.array([np.sqrt(np.mean(r**2, axis=0)) for r in found]) / scales(found)
        fitted, left = split(search.windows, misfit)
        every = (*ALWAYS, *USUAL, *POSSIBLE, *ASKED)
        parts = tuple(p for p in every if p in given or p in (*ALWAYS, *USUAL))
        parts = tuple(p for p in parts if p != "delay" or "delays" not in given)
        search = replace(search, centre=search.centre.changed(**first_values(begin, fitted)))
        now = fit(search.task(fitted, parts), begin)
        rest = left_out(search, now.values, left)
        rungs = [Rung(parts, "the usual law", size(rest), 0.0, True)]
        return cls(search, fitted, left, parts, now, rest, rungs)

    def improves(self, part: str, adds: bool) -> bool:
        """Whether the law is better with a part, or as good without it; then it is the law.

        A part is needed if left-out motion is likelier with it.
        """
        name = f"{'+' if adds else '-'} {part}"
        search, parts, first = self._with(part) if adds else self._without(part)
        if not search.joints.get(part, [-1]):
            self.rungs.append(Rung(parts, name, size(self.residuals), 0.0, False))
            return False
        other = fit(search.task(self.fitted, parts), first, SHORT)
        rest = left_out(search, other.values, self.left)
        gain = self._gain(rest, other) if adds else -self._gain(rest, self.now)
        if adds and gain > NEEDED_NATS:
            self._go_on(other.values, parts)
            gain = self._gain(rest, other)
        if part == "delays" and np.ptp(other.values["delay"]) < APART:
            gain = min(gain, 0.0)
        needed = gain > NEEDED_NATS if adds else not gain <= NEEDED_NATS
        self.rungs.append(Rung(parts, name, size(rest), gain, needed is adds))
        if needed is adds:
            self.search, self.parts, self.now, self.residuals = search, parts, other, rest
        return needed is adds

    def _without(self, part: str) -> tuple[Search, tuple[str, ...], ActuatorValues]:
        parts = tuple(p for p in self.parts if p != part)
        return self.search, parts, without(self.now.values, part)

    def _with(self, part: str) -> tuple[Search, tuple[str, ...], ActuatorValues]:
        """Where a part is searched, what else the law has then, and where a fit begins."""
        parts = (*(p for p in self.parts if p != REPLACED.get(part, "")), part)
        search, now, fitted = self.search, self.now.values, self.fitted
        if part not in SATURATION:
            off = part == "integral" and stays_off(search, now, fitted)
            own: dict[str, list[int]] = {part: []} if off else {}
            search = replace(search, joints={**search.joints, **own})
            return search, parts, with_part(search, now, part, fitted)
        known = LIMIT in self.parts
        shares = SHARES if part == "back_emf" else NONE
        starts = [_with_back_emf(search, now, fitted, shares[0])] if known else []
        if not known or any(r.tried == "+ torque_limit" and r.kept for r in self.rungs):
            # limits that fall with speed from the start may lie elsewhere than those that do not
            every = {**search.joints, LIMIT: search.joints.get("back_emf", range(now.n))}
            wide = replace(search, joints=every if known else search.joints)
            starts += [limited(wide, without(now, LIMIT), fitted, shares)]
        first, joints = min(starts, key=lambda one: size(left_out(search, one[0], fitted)))
        own = {part: joints} if len(starts) == 1 and known else {part: joints, LIMIT: joints}
        parts = parts if known or part == LIMIT else (*parts, LIMIT)
        return replace(search, joints={**search.joints, **own}), parts, first

    def _gain(self, rest: Sequence[Array], richer: Fitted) -> float:
        """Log-likelihood of left-out motion by a law that leaves `rest` over that by this one.

        Scale and correlation of residuals are those of the `richer` law: what the other one lacks
        is no noise. No window counts for more than `MOST_NATS`: one may depend on chance.
        """
        more = likelihood(rest, richer.scale) - likelihood(self.residuals, richer.scale)
        return float(np.clip(more / richer.repeated, -MOST_NATS, MOST_NATS).sum())

    def _go_on(self, values: ActuatorValues, parts: Collection[str]) -> None:
        """Fit this law further, from values of one with more parts, if that helps.

        What only goes on with a fit that has not ended is no gain of these.
        """
        for part in parts:
            values = without(values, part) if part not in self.parts else values
        again = fit(self.search.task(self.fitted, self.parts), values, SHORT)
        rest = left_out(self.search, again.values, self.left)
        if self._gain(rest, again) > 0.0:
            self.now, self.residuals = again, rest


def chosen(
    search: Search,
    start: ActuatorValues,
    stated: Mapping[str, Array],
    automatic: bool,
    progress: Callable[[str, int, int], None] = lambda what, done, all_: None,
) -> tuple[Fitted, tuple[Rung, ...], tuple[str, ...], Search]:
    """The law that predicts left-out motion best, and its fit without that motion.

    Then what was tried, the parts of the law, and the search with the joints that have them.

    A part that the user states is in the law in any case; no other one is tried unless the choice
    is `automatic`. Parts that were not needed are tried again beside one that was added, but those
    that motion is clearly against.
    """
    given = {BY_NAME[name].part for name in stated}
    if len(set(stated.get("delay", [0.0]))) > 1 or np.isnan(stated.get("delay", 0.0)).any():
        given |= {"delays"}
    todo = list(_questions(given)) if automatic else []
    vain: list[tuple[str, bool]] = []
    progress("the usual law", 0, 1 + len(todo))
    law = _Choice.begun(search, start, stated, given)
    while todo:
        part, adds = todo.pop(0)
        tried = len(law.rungs)
        progress(f"{'+' if adds else '-'} {part}", tried, 1 + tried + len(todo))
        if adds and part in law.parts:
            continue
        possible = not adds or NEEDED.get(part, law.parts[0]) in law.parts
        better = possible and law.improves(part, adds)
        if adds and better:
            todo, vain = [*todo, *vain], []
        elif adds and (not possible or law.rungs[-1].gain > -NEEDED_NATS):
            vain.append((part, adds))
    return law.now, tuple(law.rungs), law.parts, law.search


def limited(
    search: Search,
    values: ActuatorValues,
    windows: Sequence[Window],
    shares: Sequence[float] = NONE,
) -> tuple[ActuatorValues, list[int]]:
    """Values with torque limits where one lowers the error of fitted motion, and these joints.

    At these one of the `shares` of the damping acts beside the limit: fast motion has less torque.
    """
    best, joints = (size(left_out(search, values, windows)), values), list[int]()
    largest, usual = torque_of_rows(windows, values, (LARGEST, 0.5))
    for j in search.joints.get("torque_limit", range(search.step.n)):
        before, limits = best[1], np.geomspace(largest[j], usual[j], LIMITS)
        best = _least(search, windows, best, _limits(before, j, limits, shares))
        if best[1] is not before:
            joints.append(j)
            share = (best[1]["back_emf"] - before["back_emf"])[j] / before["damping"][j]
            near = best[1]["torque_limit"][j] * (limits[1] / limits[0]) ** NEAR_LIMITS
            finer = _limits(before, j, near, [share * x for x in NEAR_SHARES][: len(shares)])
            best = _least(search, windows, best, finer)
    return best[1], joints


def _limits(
    values: ActuatorValues, j: int, limits: Array, shares: Sequence[float]
) -> Iterator[Iterator[ActuatorValues]]:
    """Values with these limits of a joint, by share of the damping."""
    for share in shares:
        yield (_with_limit(values, j, limit, share) for limit in limits.tolist())


def _least(
    search: Search,
    windows: Sequence[Window],
    best: tuple[float, ActuatorValues],
    rows: Iterable[Iterable[ActuatorValues]],
) -> tuple[float, ActuatorValues]:
    """The least error, of `best` or of rows that end where they are hopeless, and its values."""
    for row in rows:
        for values in row:
            error = size(left_out(search, values, windows))
            if error > HOPELESS * best[0]:
                break
            best = (error, values) if error < best[0] * (1.0 - LEAST_LOSS) else best
    return best


def _with_limit(values: ActuatorValues, j: int, limit: float, share: float) -> ActuatorValues:
    """Values with the torque limit of a joint, beside which a share of its damping acts."""
    limits, beside = values["torque_limit"].copy(), np.zeros(values.n)
    limits[j], beside[j] = limit, share * values["damping"][j]
    damping, emf = values["damping"] - beside, values["back_emf"] + beside
    return values.changed(torque_limit=limits, damping=damping, back_emf=emf)


def _with_back_emf(
    search: Search, values: ActuatorValues, windows: Sequence[Window], share: float
) -> tuple[ActuatorValues, list[int]]:
    """Values in which some damping acts beside torque limits, and the joints that have limits.

    Below its limit a joint has one damping. At high speed as much torque is left as before.
    """
    limits = values["torque_limit"]
    joints = [j for j in search.joints.get("back_emf", range(values.n)) if limits[j] < UNLIMITED]
    speeds = [np.diff(w.q, axis=0) / np.diff(w.t)[:, None] for w in windows]
    fast = np.quantile(np.abs(np.concatenate(speeds)), FAST, axis=0)
    beside, limits = np.zeros(values.n), limits.copy()
    beside[joints] = share * values["damping"][joints]
    searched = list(search.joints.get("torque_limit", joints))
    limits[searched] += (beside * fast)[searched]
    more = {"back_emf": beside, "torque_limit": limits}
    return values.changed(damping=values["damping"] - beside, **more), joints


def _questions(given: Collection[str]) -> Iterator[tuple[str, bool]]:
    """Parts that may be added or left out, one after another; not those that are given."""
    free = [p for p in POSSIBLE if p not in given and REPLACED.get(p, "") not in given]
    yield from ((part, True) for part in free if part in FIRST)
    yield from ((part, False) for part in USUAL if part not in given)
    yield from ((part, True) for part in free if part not in FIRST)
