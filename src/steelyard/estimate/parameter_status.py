r"""How well each parameter is identified.

A parameter is *identified* if its standard deviation is small next to its value. One that is small
itself, such as a product of inertia of a symmetric link, can never be; it has a *small effect* if
no value of its 95 % interval causes much effort, in a motion that is the same for all parameters:
at random states $i$ of the robot, with speeds and accelerations of 1 rad/s and 1 rad/s² (m/s, m/s²;
root mean square), its contribution to joint $r$ is at most

$$(|\hat\phi_k| + 1.96\,s_k)\,\frac{\mathrm{rms}_i\,Y_{rk}}{\mathrm{rms}_i\,\hat\tau_r}$$

of the effort that the model predicts. The motion of the fitted runs does not decide it: a
parameter that they do not excite causes little effort in them, however large it is.
"""

from functools import lru_cache
from typing import Literal

import numpy as np

from steelyard.base.arrays import Z95, Array, frozen
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import full_regressor
from steelyard.model.model import Model

ParameterStatus = Literal[
    "identified",
    "small effect",
    "poorly identified",
    "from the prior",
    "at a bound",
    "known",
    "removed",
    "not identifiable",
]
"""`identified`: standard deviation of at most `WELL` of the value; `small effect`: at most `SMALL`
of every joint's effort, with any value of its interval; `poorly identified`: neither; `from the
prior`: less than `FROM_DATA` of it are from the data; `at a bound`: of its law or of the robot
file, so that it has no interval; `known`: given, not estimated; `removed`: zero in a reduced model;
`not identifiable`: without any effect in the logs, or inseparable from others."""

WELL = 20.0  # relative standard deviation [%] up to which a parameter is identified
SMALL = 5.0  # share of a joint's effort [%] up to which a contribution is small
FROM_DATA = 20.0  # share from data [%] below which a value comes from the prior

LEAST_EFFORT = 0.03
"""Least effort that contributions are related to, over that of the joint with the largest one of
the same unit: no drive is built for next to nothing."""

STATES, STATES_OF_LOOPS = 400, 60  # fewer of loops, which are followed from one to the next


def statuses(identified: IdentifiedModel) -> dict[str, ParameterStatus]:
    """The status of every base parameter, by its name."""
    estimate, shares = identified.estimate, effort_shares(identified)
    own, learned = estimate.parameters, estimate.learned
    learned = np.ones(len(own)) if learned is None else learned
    figures = np.column_stack([own.values, estimate.std, 100.0 * learned]).tolist()
    found = {
        name: _status(value, std, shares.get(name, np.inf), from_data)
        for name, (value, std, from_data) in zip(own.names, figures, strict=True)
    }
    found |= dict.fromkeys(estimate.at_bound, "at a bound")
    found |= dict.fromkeys(estimate.known, "known")
    found |= dict.fromkeys((blind.name for blind in estimate.blind), "not identifiable")
    found |= dict.fromkeys((removed.name for removed in estimate.removed), "removed")
    return found


def effort_shares(identified: IdentifiedModel) -> dict[str, float]:
    """Share of a joint's effort [%] that a unit of each base parameter causes, the largest one."""
    columns, base = _columns(identified.model), identified.base
    efforts = _root_mean_square(columns @ identified.valued.values.values)
    units = np.array(identified.robot.effort_units)
    largest = np.array([efforts[units == unit].max() for unit in units])
    references = np.maximum(efforts, LEAST_EFFORT * largest)
    sizes = _root_mean_square(columns)
    shares = np.divide(
        100.0 * sizes, references[:, None], out=np.zeros_like(sizes), where=sizes > 0.0
    ).max(axis=0)
    return dict(zip(base.base_names, shares[list(base.independent)].tolist(), strict=True))


def _status(value: float, std: float, share: float, from_data: float) -> ParameterStatus:
    if from_data < FROM_DATA:
        return "from the prior"
    if 100.0 * std <= WELL * abs(value) and value:
        return "identified"
    return "small effect" if (abs(value) + Z95 * std) * share <= SMALL else "poorly identified"


def _root_mean_square(values: Array) -> Array:
    """Over the samples, the second axis."""
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=1)))


@lru_cache(maxsize=4)
def _columns(model: Model) -> Array:
    """Efforts per unit of every standard parameter at random states, shape `(n, N, p)`."""
    states = STATES_OF_LOOPS if model.robot.passive else STATES
    columns = full_regressor(model, n_samples=states, slow=0.0)
    return frozen(columns.reshape(model.robot.n, states, -1))
