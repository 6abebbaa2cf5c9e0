"""Whether places are in reach, and the least shift that would bring them there."""

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.excitation.planned.inverse_kinematics import InverseKinematics

_WEIGHT = 100.0
"""A metre off the shifted target weighs as much as a shift of this many metres."""
_PADS = (1.0, 1.002, 1.01, 1.03, 1.1, 1.25)
"""Factors on the least shift; the first that is seen to work is advised."""
_PATIENCE = 200
"""Steps of the search for the least shift at most."""


def postures_at(solver: InverseKinematics, places: Array, start: Array, seed: int) -> Array | None:
    """A posture for each place, `(K, n)`, from one or as many; `None` where one is out of reach."""
    starts = np.broadcast_to(start, (len(places), len(solver.lower)))
    found = solver.solve(places, starts)
    q = found.q.copy()
    for k in np.flatnonzero(np.logical_not(found.reached)):
        again = solver.reach(places[k], starts[k], seed)
        if not again.reached[0]:
            return None
        q[k] = again.q[0]
    return q


def demand_reach(
    solver: InverseKinematics, places: Array, start: Array, seed: int, *, what: str, where: str
) -> None:
    """Refuse places that are out of reach.

    Args:
        solver: Of the inverse kinematics.
        places: Shape `(K, 3)` [m]; they would be moved together.
        start: Posture to search from, shape `(n,)` [rad; m].
        seed: Of the random starts.
        what: What the places are, such as `the pick box`.
        where: Whose reach it is.

    Raises:
        DataError: One is; says how far, and the least move of all that would help.
    """
    if postures_at(solver, places, start, seed) is not None:
        return
    shifts = [least_shift(solver, place[None], start, seed) for place in places]
    lengths = [np.inf if shift is None else float(np.linalg.norm(shift)) for shift in shifts]
    k = int(np.argmax(lengths))
    worst, shift = shifts[k], least_shift(solver, places, start, seed)
    missed = (
        "no reachable position with this orientation was found"
        if worst is None
        else f"the nearest reachable position is ({_point(places[k] + worst)}) m, "
        f"{lengths[k]:.3f} m away"
    )
    fix = (
        "no reachable shift of the whole was found: make it smaller, or relax the orientation"
        if shift is None
        else f"move {what} by ({_point(shift)}) m, {np.linalg.norm(shift):.3f} m in all: "
        "the smallest found that is reachable"
    )
    wrong = f"{what} is out of reach: of ({_point(places[k])}) m, {missed}"
    raise DataError(wrong, where=where, fix=fix)


def least_shift(solver: InverseKinematics, places: Array, start: Array, seed: int) -> Array | None:
    r"""The least common shift of places, shape `(3,)` [m], after which all can be reached.

    Minimises $\|d\|^2 + w^2 \sum_k \|p(q_k) - p_k - d\|^2$ over the shift and all postures within
    their ranges, then lengthens the shift by little until every place is seen to be reached.

    Returns:
        To the millimetre; `None` if no shift was found.
    """
    nearest = _nearest(solver, places, start, seed)
    off = solver.place(nearest) - places
    furthest = off[int(np.argmax(np.linalg.norm(off, axis=1)))]
    begun = (
        (np.mean(off, axis=0), nearest),
        (furthest, _nearest(solver, places + furthest, start, seed)),
    )
    shifts = [_shifted(solver, places, shift, q, seed) for shift, q in begun]
    good = [shift for shift in shifts if shift is not None]
    return min(good, key=lambda shift: float(np.linalg.norm(shift)), default=None)


def _nearest(solver: InverseKinematics, places: Array, start: Array, seed: int) -> Array:
    """The postures that come nearest to places, shape `(K, n)`."""
    return np.array([solver.reach(place, start, seed).q[0] for place in places])


def _shifted(
    solver: InverseKinematics, places: Array, shift: Array, q: Array, seed: int
) -> Array | None:
    """The least shift that is found from a first one and postures `(K, n)`."""
    from scipy.optimize import least_squares

    count, n = q.shape
    wide = np.full(3, np.inf)
    lower = np.concatenate([-wide, np.tile(solver.lower, count)])
    upper = np.concatenate([wide, np.tile(solver.upper, count)])
    inside = np.clip(q, solver.lower + 1e-9, solver.upper - 1e-9)

    def rest(x: Array) -> Array:
        missing = solver.missing(x[3:].reshape(count, n), places + x[:3])
        return np.concatenate([x[:3], _WEIGHT * missing.ravel()])

    def slopes(x: Array) -> Array:
        return _slopes(solver.rates(x[3:].reshape(count, n)))

    first = np.concatenate([shift, inside.ravel()])
    found = least_squares(rest, first, slopes, bounds=(lower, upper), max_nfev=_PATIENCE)
    for pad in _PADS:
        advised: Array = np.round(pad * found.x[:3], 3)
        if postures_at(solver, places + advised, found.x[3:].reshape(count, n), seed) is not None:
            return advised
    return None


def _slopes(rates: Array) -> Array:
    """How shift and misses grow with shift and postures, from rates `(K, rows, n)`."""
    count, rows, n = rates.shape
    matrix = np.zeros((3 + count * rows, 3 + count * n))
    matrix[:3, :3] = np.eye(3)
    for k, block in enumerate(rates):
        at = 3 + k * rows
        matrix[at : at + 3, :3] = _WEIGHT * np.eye(3)
        matrix[at : at + rows, 3 + k * n : 3 + (k + 1) * n] = -_WEIGHT * block
    return matrix


def _point(place: Array) -> str:
    """Coordinates to the millimetre."""
    return ", ".join(f"{x:.3f}" for x in np.round(place, 3) + 0.0)
