r"""Friction over speed in what a format holds of it.

Along a coordinate all laws together give a curve $f(v)$, odd in speed. Where each of them has a
place, and a coefficient that is not negative, all stay as they are. Else what the format holds of
$f_c + d_1 v + d_2 v^2 + d_3 v^3$ is fitted to the whole curve by non-negative least squares: a part
of the laws alone may be several times the friction that they give together.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.calibration import EDGES
from steelyard.estimation.identified import IdentifiedModel
from steelyard.terms.axes import Axis
from steelyard.terms.model_files import Kind

FRICTION: tuple[Kind, ...] = ("dry", "viscous", "quadratic", "cubic")
"""By power of speed."""

NEGLIGIBLE = 1e-6
"""Friction up to the greatest speed that is zero, relative to the greatest of the curve."""

ROUNDING = 1e-9
"""Friction this little is a solver's rounding, and zero [Nm; N]."""

FITTED = np.linspace(0.0, 1.0, 201)[1:]
"""Speeds of a fit, over the greatest."""

COMPARED = np.concatenate([np.geomspace(1e-4, 5e-3, 30), np.linspace(5e-3, 1.0, 1000)])
"""Speeds at which a fit is compared with the curve, over the greatest."""

UNKNOWN = 1.0
"""Greatest speed where neither logs nor limits give one [rad/s; m/s]."""

Force = Callable[[Array], Array]
"""Friction at speeds above zero."""


class Supported(NamedTuple):
    """What a format supports of the friction along a coordinate.

    Attributes:
        effects: Coefficients by kind, above zero.
        fit: Whether they are a fit.
        largest: Largest difference to the friction of the model up to the greatest speed [Nm; N].
        rms: Root mean square of the difference over these speeds [Nm; N].
    """

    effects: dict[Kind, float]
    fit: bool = False
    largest: float = 0.0
    rms: float = 0.0


def supported_friction(
    own: Mapping[Kind, float], others: Sequence[Force], kinds: Iterable[Kind], top: float
) -> Supported:
    """Friction along a coordinate in what a format supports.

    Args:
        own: Coefficients of the powers of speed.
        others: What else there is of friction.
        kinds: What the format supports.
        top: The greatest speed [rad/s; m/s].
    """

    def curve(v: Array) -> Array:
        powers = [x * v ** FRICTION.index(kind) for kind, x in own.items()]
        return np.asarray(sum([*powers, *(force(v) for force in others)], np.zeros_like(v)))

    whole, places = curve(top * FITTED), [kind for kind in FRICTION if kind in kinds]
    least = max(NEGLIGIBLE * float(np.abs(whole).max()), ROUNDING)
    sizes = {kind: x * top ** FRICTION.index(kind) for kind, x in own.items()}
    kept = {kind: own[kind] for kind, size in sizes.items() if abs(size) > least}
    beside = any(np.abs(force(top * FITTED)).max() > least for force in others)
    if not beside and all(x > 0.0 and kind in places for kind, x in kept.items()):
        return Supported(kept)
    effects = _fitted(whole, places, least, top)
    left = curve(top * COMPARED)
    for kind, x in effects.items():
        left -= x * (top * COMPARED) ** FRICTION.index(kind)
    rms = np.sqrt(np.trapezoid(np.square(left), COMPARED))
    return Supported(effects, True, float(np.abs(left).max()), float(rms))


def _fitted(whole: Array, places: Sequence[Kind], least: float, top: float) -> dict[Kind, float]:
    """Coefficients that are not negative, and not negligible, nearest to a curve at `FITTED`."""
    from scipy.optimize import nnls

    powers = np.array([FRICTION.index(kind) for kind in places])
    sizes = nnls(FITTED[:, None] ** powers, whole)[0]
    return {
        kind: float(size / top**power)
        for kind, power, size in zip(places, powers, sizes, strict=True)
        if size > least
    }


def greatest_speed(identified: IdentifiedModel, axis: Axis) -> float:
    """Greatest speed along a coordinate in the fitted logs, or that of the limits [rad/s; m/s].

    Rows of long logs stand far apart; speed is then at least that of the sine of the same root mean
    square, where the calibration of the bands has them.
    """
    robot, row = identified.model.robot, np.array(axis.row)
    speeds = [0.0]
    if not row[robot.n :].any():
        mine = row[: robot.n]
        for samples in identified.motions:
            t, x = np.diff(samples.t), np.diff(samples.q @ mine)
            near = (t > 0.0) & (t < 1.5 * samples.step)
            speeds += (np.abs(x[near]) / t[near]).tolist()
        if identified.calibration is not None:
            typical = identified.calibration.edges[:, 0] / EDGES[0]
            speeds.append(float(np.sqrt(2.0) * np.linalg.norm(mine * typical)))
    if max(speeds) > 0.0:
        return max(speeds)
    limit = sum(abs(c) * x.limits.velocity for c, x in zip(row, robot.joints, strict=True) if c)
    return float(limit) if 0.0 < limit < np.inf else UNKNOWN
