r"""Torque of the controllers' integral gains when a rollout begins.

Along a log it grows by what was measured, $w(t) = w_0 + k_i \int (u - q)$, and forces balance on
average over the log, as no joint is faster in the end than at first, and dry friction has either
sign,

$$ \bar w = \overline{g(q)} - k_p\, \overline{(u - q)}, $$

which tells $w_0$ (with errors behind the dead band; that a torque limit holds the integral is left
out here). A rollout from the first row on, where a log is predicted from its targets alone,
begins with the balance at that row.
"""

from collections.abc import Sequence

import numpy as np

from steelyard.actuators.actuator_parameters import ActuatorValues, Free, moved
from steelyard.actuators.closed_loop_step import ArmStep
from steelyard.actuators.target_runs import TargetRun
from steelyard.base.arrays import Array

DIFFERENCE = 1e-5  # of a parameter, for slopes
SOME = 500  # rows of a log that show the mean weight of its links
OF_THE_ERROR, OF_THE_WEIGHT = (
    ("stiffness", "integral", "offset", "delay", "dead_band"),
    ("zero", "mass_factor"),
)
"""Parameters that what integrals hold depends on."""


def integral_torques(
    step: ArmStep, values: ActuatorValues, run: TargetRun, rows: Sequence[int]
) -> Array:
    """In the model's joints, at rows of a log from which rollouts begin, `(K, n)` [Nm; N]."""
    return _held(values, _weight(step, values, run), run, rows)


def integral_slopes(
    step: ArmStep, values: ActuatorValues, run: TargetRun, rows: Sequence[int], free: Sequence[Free]
) -> Array:
    """Derivatives of `integral_torques` by what is searched, by differences, `(K, n, p)`."""
    found = np.zeros((len(rows), values.n, len(free)))
    weight = _weight(step, values, run)
    for k, one in enumerate(free):
        if one.name in (*OF_THE_ERROR, *OF_THE_WEIGHT):
            by = DIFFERENCE * (np.arange(len(free)) == k)
            ends = []
            for changed in (moved(values, free, by), moved(values, free, -by)):
                new = _weight(step, changed, run) if one.name in OF_THE_WEIGHT else weight
                ends.append(_held(changed, new, run, rows))
            found[:, :, k] = (ends[0] - ends[1]) / (2.0 * DIFFERENCE)
    return found


def _held(
    values: ActuatorValues, weight: tuple[Array, Array], run: TargetRun, rows: Sequence[int]
) -> Array:
    """What integrals hold, with the torque of the links' weight at first and on average."""
    s, kp, ki = values.signs, values["stiffness"], values["integral"]
    error = s * (run.target_at(run.t, values["delay"]) + values["offset"] - run.q)
    error = error - np.clip(error, -values["dead_band"], values["dead_band"])
    steps = np.diff(run.t)[:, None] * 0.5 * (error[1:] + error[:-1])
    grown = ki * np.concatenate([np.zeros((1, len(s))), np.cumsum(steps, axis=0)])
    along = grown[list(rows)] + weight[1] - kp * error.mean(axis=0) - grown.mean(axis=0)
    first = np.array(rows)[:, None] == 0
    return np.asarray(np.where(ki > 0.0, np.where(first, weight[0] - kp * error[0], along), 0.0))


def _weight(step: ArmStep, values: ActuatorValues, run: TargetRun) -> tuple[Array, Array]:
    """Torque of the links' weight, with factors on masses: at the first row and on average."""
    coordinates = [body.coordinate for body in step.model.robot.bodies]
    links = step.values.reshape(-1, 10) * values["mass_factor"][coordinates][:, None]
    q = values.signs * run.q[:: max(1, len(run.q) // SOME)] + values["zero"]
    still, none = np.zeros(q.T.shape), np.empty((0, len(q)))
    given = [np.ascontiguousarray(q.T), still, still, none, links.ravel()]
    found = step.model.torque_code(given)
    return found[:, 0], found.mean(axis=1)
