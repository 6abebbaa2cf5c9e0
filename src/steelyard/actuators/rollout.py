r"""Rollouts of windows of logs from targets alone, side by side, and their derivatives.

All windows, and all directions that a derivative is wanted along, are lanes of one machine code:
the derivative of a rollout is carried through its steps (forward sensitivities), exactly.
"""

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.actuators.actuator_parameters import IN_STEP, ActuatorValues, Free
from steelyard.actuators.closed_loop_step import CARRIED, DIRECTIONS, STATE, VARIED, ArmStep
from steelyard.actuators.integral_state import integral_slopes, integral_torques
from steelyard.actuators.target_runs import TargetRun, Window
from steelyard.base.arrays import Array, by_key
from steelyard.symbolic.native.compiled_programs import Code

STEP = 0.005
"""Length of a step [s], at most; a row of a log is a whole number of them, nearly."""
LANES = 512  # of a batch, that its states stay in the cache
KEPT_BYTES = 200e6  # of derivatives that a batch keeps


@dataclass(frozen=True, eq=False)
class Rolled:
    """A window rolled out: positions, velocities, and torques of integral gains at its rows.

    All `(N, n)`, as the log counts them.

    `slopes` are the derivatives by what is searched, `(N, n, p)`; empty if none were wanted.
    `finer` is what shorter steps than those of the slopes add to the positions `(N, n)`, or 0.
    """

    q: Array
    v: Array
    held: Array
    slopes: Array
    finer: Array | float = 0.0


def rollouts(
    step: ArmStep,
    values: ActuatorValues,
    windows: Sequence[Window],
    free: Sequence[Free] = (),
    h: float = STEP,
    threads: int = 2,
) -> list[Rolled]:
    """All windows rolled out from their first rows, in their order."""
    lengths = [float(w.t[-1] - w.t[0]) for w in windows]
    order = sorted(range(len(windows)), key=lambda k: lengths[k])
    batches = _batches(order, lengths, max(1, len(free)), step.n, h, threads)
    code = step.tangent if free else step.code

    def one(batch: Sequence[int]) -> list[Rolled]:
        return _Batch(step, values, [windows[k] for k in batch], free, h).run(code)

    found: dict[int, Rolled] = {}
    with ThreadPoolExecutor(threads) as pool:
        for batch, rolled in zip(batches, pool.map(one, batches), strict=True):
            found.update(zip(batch, rolled, strict=True))
    return [found[k] for k in range(len(windows))]


def _batches(
    order: Sequence[int], lengths: Sequence[float], directions: int, n: int, h: float, threads: int
) -> list[list[int]]:
    """Windows of like lengths together, as many as fit; at least one batch a thread."""
    lanes = -(-directions // DIRECTIONS)
    most = max(1, min(LANES // lanes, -(-len(order) // threads)))
    batches: list[list[int]] = []
    for k in order:
        steps = lengths[k] / h
        fits = batches and len(batches[-1]) < most
        size = (len(batches[-1]) + 1) * steps * n * directions * 8.0 if batches else 0.0
        if fits and size <= KEPT_BYTES:
            batches[-1].append(k)
        else:
            batches.append([k])
    return batches


class _Batch:
    """Some windows side by side; a lane is a window along one direction, windows the faster."""

    def __init__(
        self,
        step: ArmStep,
        values: ActuatorValues,
        windows: Sequence[Window],
        free: Sequence[Free],
        h: float,
    ) -> None:
        self.step, self.n = step, step.n
        self.values, self.windows, self.free, self.h = values, windows, free, h
        self.steps = max(1, *(int(np.ceil((w.t[-1] - w.t[0]) / h - 1e-6)) for w in windows))
        self.targets, self.lateness = self._targets()
        middle = (np.arange(self.steps) + 0.5) * h
        self.supply = np.stack([w.run.supplied(w.t[0] + middle) for w in windows], axis=1)

    def _targets(self) -> tuple[Array, Array]:
        """Targets of the model's joints, and their slopes by the delay, `(steps, n, windows)`."""
        s, v = self.values.signs, self.values
        shape = (self.steps, self.n, len(self.windows))
        mean, slope = np.empty(shape), np.empty(shape)
        ahead = (np.arange(self.steps) + 0.5) * self.h  # about the end of each step
        for k, window in enumerate(self.windows):
            u, by = window.run.mean_target(window.t[0] + ahead, self.h, v["delay"])
            mean[:, :, k], slope[:, :, k] = s * (u + v["offset"]) + v["zero"], s * by
        return mean, slope

    def run(self, code: Code) -> list[Rolled]:
        """All steps."""
        count, n, p = len(self.windows), self.n, len(self.free)
        groups = max(1, -(-p // DIRECTIONS))
        wide = groups * count
        padded = -(-wide // code.lanes) * code.lanes
        state = self._start(padded, groups)
        rates = self._directions(padded) if p else []
        out = np.zeros((code.n_outputs, padded))
        arrays = [*state, *(array for along in rates for array in along.values())]
        addresses = [x for a in arrays for x in (a.ctypes.data, padded)]
        length = np.array([self.h])
        arguments = [padded, *addresses, length.ctypes.data, 0, out.ctypes.data, padded]
        q, v, _, q0, v0, u = state[: len(STATE) + 1]
        kept = np.empty((CARRIED, count, self.steps + 1, n))
        slopes = np.empty((count, self.steps + 1, n, p))
        fed = _Fed.of(state[len(STATE) + 1 :], rates) if (self.supply != 1.0).any() else None
        late = [d for d, one in enumerate(self.free) if one.name == "delay"]
        for k in range(self.steps + 1):
            for part, own in zip(kept, state, strict=False):
                part[:, k] = own[:, :count].T
            for slot, along in enumerate(rates):
                by = along["q"][:, :wide].reshape(n, groups, count).transpose(2, 0, 1)
                some = slopes[:, k, :, slot::DIRECTIONS]
                some[:] = by[:, :, : some.shape[2]]
            if k == self.steps:
                break
            u[:, :wide].reshape(n, -1, count)[:] = self.targets[k][:, None]
            if fed is not None:
                fed.at(np.tile(self.supply[k], groups))
            for d in late:
                j = self.free[d].joint
                joints = slice(None) if j < 0 else slice(j, j + 1)
                rates[d % DIRECTIONS]["target"][joints, self._lanes(d)] = self.lateness[k, joints]
            code.raw(*arguments)
            blocks = out.reshape(-1, n, padded)
            q0[:], v0[:] = q, v
            for old, new in zip(state, blocks[:CARRIED], strict=False):
                old[:] = new
            for slot, along in enumerate(rates, start=1):
                along["q_before"][:], along["v_before"][:] = along["q"], along["v"]
                own = blocks[CARRIED * slot : CARRIED * (slot + 1)]
                for name, new in zip(STATE, own, strict=False):
                    along[name][:] = new
        return [self._rows(k, kept[:, k], slopes[k]) for k in range(count)]

    def _lanes(self, d: int) -> slice:
        """Lanes of direction `d`, in the slot that it has in each of them."""
        count = len(self.windows)
        return slice(d // DIRECTIONS * count, (d // DIRECTIONS + 1) * count)

    def _start(self, padded: int, groups: int) -> list[Array]:
        """Inputs of the step at the first rows, `(n, padded)` each."""
        s, zero = self.values.signs, self.values["zero"]
        arrays = [np.zeros((self.n, padded)) for _ in range(len(STATE) + 1)]
        lanes = groups * len(self.windows)
        for k, window in enumerate(self.windows):
            mine = slice(k, lanes, len(self.windows))
            arrays[0][:, mine] = (s * window.position + zero)[:, None]
            arrays[1][:, mine] = (s * window.velocity)[:, None]
        for run, windows in self._with_integrals():
            rows = [self.windows[k].start for k in windows]
            found = integral_torques(self.step, self.values, run, rows)
            for k, held in zip(windows, found, strict=True):
                arrays[2][:, k : lanes : len(self.windows)] = held[:, None]
        arrays[3][:], arrays[4][:] = arrays[0] - self.h * arrays[1], arrays[1]
        ones = np.ones((1, padded))
        return [*arrays, *(self.values[name][:, None] * ones for name in IN_STEP)]

    def _directions(self, padded: int) -> list[dict[str, Array]]:
        """What each lane varies, by input, for each of its slots."""
        rates = [{name: np.zeros((self.n, padded)) for name in VARIED} for _ in range(DIRECTIONS)]
        for d, one in enumerate(self.free):
            along, lanes, j = rates[d % DIRECTIONS], self._lanes(d), one.joint
            if one.name in IN_STEP:
                along[one.name][j, lanes] = one.slope(self.values)
            elif one.name == "offset":
                along["target"][j, lanes] = self.values.signs[j]
            elif one.name == "zero":
                for name in ("q", "q_before", "target"):
                    along[name][j, lanes] = 1.0
        for run, windows in self._with_integrals():
            rows = [self.windows[k].start for k in windows]
            by = integral_slopes(self.step, self.values, run, rows, self.free)
            for d in range(len(self.free)):
                own = d // DIRECTIONS * len(self.windows) + np.array(windows)
                rates[d % DIRECTIONS]["integral_torque"][:, own] = by[:, :, d].T
        return rates

    def _with_integrals(self) -> Iterable[tuple[TargetRun, list[int]]]:
        """Runs and the windows of each; none if no controller has an integral gain."""
        if not self.values["integral"].any():
            return ()
        return by_key((window.run, k) for k, window in enumerate(self.windows)).items()

    def _rows(self, k: int, kept: Array, slopes: Array) -> Rolled:
        """Of window `k` from the steps to its rows, between two steps on a line."""
        window, s = self.windows[k], self.values.signs
        place = np.clip((window.t - window.t[0]) / self.h, 0.0, self.steps)
        at = np.minimum(place.astype(int), self.steps - 1)
        share = (place - at)[:, None]
        q, v, held = kept[:, at] * (1.0 - share) + kept[:, at + 1] * share
        by: Any = slopes[at] * (1.0 - share[..., None]) + slopes[at + 1] * share[..., None]
        for d, one in enumerate(self.free):
            if one.name == "zero":
                by[:, one.joint, d] -= 1.0
        return Rolled(s * (q - self.values["zero"]), s * v, s * held, s[:, None] * by)


FED = ("stiffness", "torque_limit")
"""Parameters that are proportional to the voltage that actuators are fed with."""


@dataclass(frozen=True, eq=False)
class _Fed:
    """Inputs that follow the supply, each with what it is at the nominal one."""

    inputs: Sequence[tuple[Array, Array]]

    @classmethod
    def of(cls, values: Sequence[Array], rates: Sequence[dict[str, Array]]) -> "_Fed":
        """Of values of `IN_STEP`, and what lanes vary."""
        own = dict(zip(IN_STEP, values, strict=True))
        every = [of[name] for of in (own, *rates) for name in FED]
        return cls([(array, array.copy()) for array in every])

    def at(self, supply: Array) -> None:
        """Set them for this supply of each lane."""
        for array, nominal in self.inputs:
            array[:, : len(supply)] = nominal[:, : len(supply)] * supply
