r"""Torque of the controllers' integral gains when a rollout begins.

Along a log it grows by what was measured, $w(t) = w_0 + k_i \int (u - q)$, and forces balance on
average over the log, as no joint is faster in the end than at first, and dry friction has either
sign,

$$ \bar w = \overline{g(q)} - k_p\, \overline{(u - q)}, $$

which tells $w_0$. A rollout from the first row on, where a log is predicted from its targets alone,
begins with the balance at that row.
"""

from collections.abc import Sequence

import numpy as np

from steelyard.actuators.actuator_parameters import ActuatorValues, Free, moved
from steelyard.actuators.closed_loop_step import ArmStep
from steelyard.actuators.target_runs import TargetRun
from steelyard.base.arrays import Array

SIGHT = 1e-4  # over which a held target is averaged [s]
DIFFERENCE = 1e-5  # of a parameter, for slopes


def integral_torques(
    step: ArmStep, values: ActuatorValues, run: TargetRun, rows: Sequence[int]
) -> Array:
    """In the model's joints, at rows of a log from which rollouts begin, `(K, n)` [Nm; N]."""
    q, s, ki = values.signs * run.q + values["zero"], values.signs, values["integral"]
    u, _ = run.mean_target(run.t - SIGHT, SIGHT, values["delay"])
    error = s * (u + values["offset"] - run.q)
    steps = np.diff(run.t)[:, None] * 0.5 * (error[1:] + error[:-1])
    grown = ki * np.concatenate([np.zeros((1, len(s))), np.cumsum(steps, axis=0)])
    needed = _gravity(step, values, q) - values["stiffness"] * error
    along = grown[list(rows)] + (needed - grown).mean(axis=0)
    first = np.array(rows)[:, None] == 0
    return np.asarray(np.where(ki > 0.0, np.where(first, needed[0], along), 0.0))


def integral_slopes(
    step: ArmStep, values: ActuatorValues, run: TargetRun, rows: Sequence[int], free: Sequence[Free]
) -> Array:
    """Derivatives of `integral_torques` by what is searched, by differences, `(K, n, p)`."""
    found = np.empty((len(rows), values.n, len(free)))
    for k in range(len(free)):
        by = DIFFERENCE * (np.arange(len(free)) == k)
        ends = [integral_torques(step, moved(values, free, x), run, rows) for x in (by, -by)]
        found[:, :, k] = (ends[0] - ends[1]) / (2.0 * DIFFERENCE)
    return found


def _gravity(step: ArmStep, values: ActuatorValues, q: Array) -> Array:
    """Torque of the links' weight, with factors on masses, `(N, n)`."""
    coordinates = [body.coordinate for body in step.model.robot.bodies]
    links = step.values.reshape(-1, 10) * values["mass_factor"][coordinates][:, None]
    still = np.zeros(q.T.shape)
    none = np.empty((0, len(q)))
    return step.model.torque_code([np.ascontiguousarray(q.T), still, still, none, links.ravel()]).T
