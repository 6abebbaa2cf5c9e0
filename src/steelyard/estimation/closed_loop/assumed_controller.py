r"""A controller for logs that do not say how the robot was controlled.

It follows the log's own smoothed motion by joint feedback of 20 Hz, critically damped, with the
inertias that the log shows, and adds the log's own smoothed torque to it: a model with the right
values then needs next to no feedback. What is simulated is therefore the logged motion seen
through a loop of some 20 Hz; it holds no noise that such a loop does not pass.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.closed_loop.controller import tuned_pd
from steelyard.estimation.closed_loop.experiment import Experiment, Loop, Measured
from steelyard.measurement.methods.lowpass import zero_phase

BANDWIDTH = 20.0
"""Natural frequency of the joints' errors [Hz]."""

_TORQUE_CUTOFF = 2.0
"""Low-pass of the torque that is added, over the regression cut-off."""

_HIGHEST = 0.4

NOTE = (
    "the log contains no controller data: a joint controller of "
    f"{BANDWIDTH:g} Hz is assumed, which follows the log's smoothed motion and adds its smoothed "
    "torque"
)


def stand_in(experiment: Experiment) -> Experiment:
    """The experiment with loops of our own.

    Raises:
        DataError: There are no values to begin with, see `Experiment.start_values`.
    """
    q, start_values = experiment.postures, experiment.start_values
    still = np.zeros_like(q)
    masses = experiment.dynamics.mass_and_bias(q, still, start_values.values, start_values.widths)[
        0
    ]
    loops = []
    for run in experiment.runs:
        controller = tuned_pd(masses, BANDWIDTH, run.rate * run.ticks)
        loops.append(Loop(controller, *_followed(run)))
    return replace(experiment, loops=tuple(loops), notes=(*experiment.notes, NOTE))


Wanted = Callable[[Array], tuple[Array, Array]]


def _followed(run: Measured) -> tuple[Wanted, Callable[[Array], Array]]:
    """The controller's setpoints, and the torque that is added, over time."""
    from scipy.interpolate import CubicHermiteSpline

    motion = run.motion
    q = CubicHermiteSpline(motion.t, motion.q, motion.dq)
    dq = CubicHermiteSpline(motion.t, motion.dq, motion.ddq)
    cutoff = min(_TORQUE_CUTOFF * run.cutoff, _HIGHEST * run.rate)
    smooth = zero_phase(run.tau, cutoff, run.rate)

    def wanted(t: Array) -> tuple[Array, Array]:
        inside = np.clip(t, motion.t[0], motion.t[-1])
        return np.asarray(q(inside)), np.asarray(dq(inside))

    def ahead(t: Array) -> Array:
        return np.column_stack([np.interp(t, motion.t, column) for column in smooth.T])

    return wanted, ahead
