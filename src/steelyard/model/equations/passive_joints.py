"""Passive positions along a motion: Newton's method, warm-started from sample to sample."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.model.equations.inverse_dynamics import JointState, completed, corrected
from steelyard.robot.loop_closures import CLOSED, closest, gaps, loop_equations, residual
from steelyard.robot.robot import Robot, robot_to_dict
from steelyard.symbolic.native.compiled_programs import Code, SampleCall, compiled_equations
from steelyard.symbolic.program_and_softening import InputArray as Input

ITERATIONS = 12  # Newton steps after which a sample counts as open
STRIDE = 0.5  # passive joints that would move farther at once are followed in halves [rad; m]
HALVINGS = 6  # how often a way is halved before its end counts as open

FASTEST = 20.0
"""Speed of a passive joint per speed of an independent one beyond which a dead point is near."""

RANDOM_WALK_STEP = 0.1  # independent joints of a random walk move by this at once [rad; m]

REGULAR = 0.1
"""Least over greatest singular value of the loops' derivative by the passive joints below which a
random walk turns back: beyond a singular posture the mechanism may be assembled in another way."""

_CLOSED = 1e-9  # distance of two points of a loop that is closed [m]
_TOLERANCE = 1e-8  # a last Newton step: the error after it is of the order of its square


class Follower:
    """Finds the passive positions of consecutive samples; `closed` is where loops closed last.

    It starts at the robot's assembly and follows the way to each sample, so that the mechanism
    stays assembled as it is.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.closed: tuple[Array, Array]
        self._drift: Array
        self._newton = _Newton(robot)
        self.restart()

    def __call__(self, q: Array, stop: bool = False) -> tuple[Array, NDArray[np.bool_]]:
        """Passive positions of samples `q` `(n, N)`, and whether loops close, `(N,)`.

        Where they do not, positions are those that closed last; with `stop` nothing behind is
        looked at.
        """
        passive = np.empty((len(self.robot.passive), q.shape[1]))
        good = np.zeros(q.shape[1], dtype=bool)
        # a copy: the caller may reuse its array, and `closed` outlives the call
        for k, sample in enumerate(np.array(q.T, order="C")):
            good[k] = self.step(sample)
            passive[:, k] = self.closed[1]
            if stop and not good[k]:
                break
        return passive, good

    def step(self, q: Array) -> bool:
        """Follow the loops to one more sample, shape `(n,)`; whether they close there."""
        last = self.closed[1]
        found = self._newton(q, last + self._drift)
        if found is None or _largest(found - last) > STRIDE:
            found = self._towards(*self.closed, q, HALVINGS)
        if found is None:
            self._drift = np.zeros_like(self._drift)
            return False
        self._drift = found - last
        self.closed = (q, found)
        return True

    def restart(self, closed: tuple[Array, Array] | None = None) -> None:
        """Go on from positions where the loops are closed, `(n,)` and `(n_passive,)`, if given."""
        if closed is None:
            first, passive = np.split(loop_equations(self.robot).assembly, [self.robot.n])
            closed = first, passive
        self.closed, self._drift = closed, np.zeros(len(self.robot.passive))

    def gap(self, q: Array) -> tuple[str, float]:
        """Which loop stays open at a sample, shape `(n,)`, and its points' distance [m]."""
        robot = self.robot
        start = np.concatenate([q, self.closed[1]])
        distances = gaps(robot, closest(robot, start, range(robot.n, robot.n_joints)))
        worst = int(distances.argmax())
        return robot.loops[worst].name, float(distances[worst])

    def _towards(self, start: Array, passive: Array, q: Array, halvings: int) -> Array | None:
        """Passive positions at `q`, found on a straight way that begins at closed loops."""
        found = self._newton(q, passive)
        if found is not None and _largest(found - passive) <= STRIDE:
            return found
        if not halvings:
            return None
        middle = 0.5 * (start + q)
        between = self._towards(start, passive, middle, halvings - 1)
        return None if between is None else self._towards(middle, between, q, halvings - 1)


def open_loop(
    follower: Follower, q: Array, closed: NDArray[np.bool_], t: Array | None
) -> DataError:
    """What to say of the first sample that is not closed, where the follower stopped."""
    first = int(np.argmin(closed))
    name, gap = follower.gap(q[:, first])
    when = "at this sample" if t is None else f"at t = {t[first]:.4f} s"
    if gap < _CLOSED:
        return DataError(
            f"loop '{name}' closes {when}, but the position before does not lead there",
            where=f"robot '{follower.robot.name}'",
            fix="give samples between the two; where the chain is singular, its passive joints "
            "have several positions or none",
        )
    return DataError(
        f"loop '{name}' does not close {when}: closure error {gap:.3g} m",
        where=f"robot '{follower.robot.name}', measured positions",
        fix="check the loop's points and links, and the zeros and signs of the positions; or "
        'write open_loops = "drop" under [robot] to leave such samples out',
    )


def passive_positions(robot: Robot, q: Array) -> Array:
    """Positions `(n_passive, N)` of the passive joints of consecutive samples `q`, `(n, N)`."""
    if not robot.passive:
        return np.empty((0, q.shape[1]))
    follower = Follower(robot)
    passive, closed = follower(q, stop=True)
    if not closed.all():
        raise open_loop(follower, q, closed, None)
    return passive


def all_joints(
    robot: Robot, q: Array, dq: Array, ddq: Array, passive: Array
) -> tuple[Array, Array, Array]:
    """Motion of all joints, each `(n_joints, N)`, from `(n, N)` and `(n_passive, N)`."""
    if not robot.passive:
        return q, dq, ddq
    state, _ = completed(robot, JointState([*q], [*dq], [*ddq], [*passive]))
    first, second, third = (
        np.stack(np.broadcast_arrays(*x)) for x in (state.q, state.dq, state.ddq)
    )
    return first, second, third


def random_positions(robot: Robot, n_samples: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Positions anywhere `(n, N)`; with loops, a walk from the assembly, and passive ones.

    The walk keeps to the limits of the independent joints, away from dead points, and passes no
    singular posture, so that the mechanism stays assembled as it is: a parallelogram whose bars lie
    in one line could go on as an antiparallelogram. Passive positions have shape `(n_passive, N)`.
    """
    if not robot.passive:
        return rng.uniform(-np.pi, np.pi, (robot.n, n_samples)), np.empty((0, n_samples))
    follower = Follower(robot)
    start = follower.closed[0]
    lower, upper = (
        np.array([getattr(c.limits, side) for c in robot.coordinates])
        for side in ("lower", "upper")
    )
    lower = np.minimum(start, np.where(np.isfinite(lower), lower, start - np.pi))
    upper = np.maximum(start, np.where(np.isfinite(upper), upper, start + np.pi))
    found: list[tuple[Array, Array]] = []
    reach, fastest = 1.0, max(FASTEST, 2.0 * _speed(robot, *follower.closed))
    least = min(REGULAR, 0.5 * _regularity(robot, *follower.closed))
    while len(found) < n_samples:
        here = follower.closed
        aim = here[0] + reach * (rng.uniform(lower, upper) - here[0])
        if _walked(follower, aim, least) and _speed(robot, *follower.closed) <= fastest:
            found.append(follower.closed)
            reach = 1.0
        else:
            follower.restart(here)
            reach *= 0.5
    q, passive = (np.array(x).T for x in zip(*found, strict=True))
    return q, passive


def _speed(robot: Robot, q: Array, passive: Array) -> float:
    """Largest speed of a passive joint per speed of an independent one."""
    still = [0.0] * robot.n
    _, torque_map = completed(robot, JointState([*q], still, still, [*passive]))
    return float(np.abs([g for row in torque_map for g in row if g is not None]).max(initial=0.0))


def _walked(follower: Follower, aim: Array, least: float) -> bool:
    """Follow the loops to an aim in short steps; whether they close and are regular all along."""
    follower.restart(follower.closed)
    start = follower.closed[0]
    steps = max(1, int(np.ceil(np.abs(aim - start).max() / RANDOM_WALK_STEP)))
    return all(
        follower.step(start + share * (aim - start))
        and _regularity(follower.robot, *follower.closed) >= least
        for share in np.arange(1, steps + 1) / steps
    )


def _regularity(robot: Robot, q: Array, passive: Array) -> float:
    """Least over greatest singular value of the loops' derivative by the passive joints."""
    slopes = residual(robot, np.concatenate([q, passive]))[1][:, robot.n :]
    sizes = np.linalg.svd(slopes, compute_uv=False)
    return float(sizes[-1] / sizes[0])


class _Newton:
    """Newton's method for the passive positions of one sample, see `sample`."""

    def __init__(self, robot: Robot) -> None:
        code, n, count = newton_code(robot), robot.n, len(robot.passive)
        given = np.zeros(n + count + code.lanes - 1)
        self._q, self._passive = given[:n], given[n : n + count]
        self._sample = SampleCall(code, [self._q, self._passive], given[: n + count])
        self._new, self._gaps = self._sample.result[:count], self._sample.result[count:]

    def __call__(self, q: Array, start: Array) -> Array | None:
        """Passive positions where the loops close, from a start nearby; `None` if they do not."""
        self._q[:], self._passive[:] = q, start
        for _ in range(ITERATIONS):
            if not self._sample.call():
                return None
            step = _largest(self._new - self._passive)
            self._passive[:] = self._new
            if step < _TOLERANCE:
                return self._new.copy() if _largest(self._gaps) <= CLOSED**2 else None
        return None


def _largest(values: Array) -> float:
    """Largest size of some finite values; of a few, faster than with NumPy."""
    return float(max(map(abs, values.tolist())))


def passive_ways(robot: Robot, back: Sequence[int] | None = None) -> Code:
    """Speeds of passive joints per speed of independent ones, row by row.

    Inputs are independent and passive positions; for `back` see `compiled_equations`.
    """
    still = [0.0] * robot.n

    def rows(q: Any, passive: Any) -> list[Any]:
        ways = completed(robot, JointState(q, still, still, passive))[1]
        return [0.0 if x is None else x for row in ways for x in row]

    inputs = Input("q", robot.n), Input("passive", len(robot.passive))
    return compiled_equations(["passive ways", robot_to_dict(robot)], rows, inputs, back=back)


def newton_code(robot: Robot) -> Code:
    """Machine code of `corrected`: inputs are independent and passive positions."""
    described = robot_to_dict(robot)
    for body in described["bodies"]:
        del body["inertia"], body["known"]
    inputs = Input("q", robot.n), Input("passive", len(robot.passive))
    return compiled_equations(["loops", described], lambda *x: corrected(robot, *x), inputs)
