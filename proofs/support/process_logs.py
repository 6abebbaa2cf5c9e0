"""Logs of processes at random: moves from point to point with pauses, some joints standing."""

from dataclasses import dataclass

import numpy as np

BITS = 2.0 * np.pi / 2.0 ** np.array([16, 18, 20])  # steps of encoders [rad]
AREA, APART = 0.6, 0.8
"""Where a process picks and puts: ranges of its points, and between the middles of both [rad]."""
PUSHED = 5e-4
"""How far standing joints are pushed by those that move, in radians per radian, at most."""


@dataclass(frozen=True, eq=False)
class ProcessLog:
    """Positions of a process and what is true of them."""

    q: np.ndarray  # positions, shape `(n, N)` [rad]
    rate: float  # samples per second
    standing: int  # joints that carry only noise and what the others push them
    period: float  # time between repetitions [s]; of the whole process if it is not repeated
    repetitions: int


def process_log(seed: int, *, repeated: bool, standing: int | None = None) -> ProcessLog:
    """A random process: cycles of picks and puts that are all the same, or each other places.

    All moves have minimum jerk and take 0.3 to 1 s, pauses up to 0.5 s. Before and behind the
    process the arm rests.

    Args:
        seed: Of everything.
        repeated: Whether all cycles are the same; else each has places of its own.
        standing: Joints that stand, one to all but one of 2 to 7 if `None`.
    """
    rng = np.random.default_rng([seed, repeated])
    joints = int(rng.integers(2, 8)) if standing is None else max(standing + 1, 6)
    still = int(rng.integers(1, joints)) if standing is None else standing
    rate, count = float(rng.choice([100.0, 250.0, 500.0])), int(rng.integers(3, 13))
    moves = int(rng.integers(2, 5))
    middle = rng.uniform(-1.0, 1.0, joints)
    side = rng.choice([-0.5, 0.5], joints) * APART

    def cycle() -> list[np.ndarray]:
        around = AREA * rng.uniform(-0.5, 0.5, (2 * moves, joints))
        return [middle + side * (-1.0) ** k + around[k] for k in range(2 * moves)]

    times, pauses = rng.uniform(0.3, 1.0, 2 * moves), rng.uniform(0.0, 0.5, 2 * moves)
    first = cycle()
    pieces = [np.repeat(first[-1][:, None], int(rng.uniform(0.0, 2.0) * rate), axis=1)]
    now = first[-1]
    for number in range(count):
        for target, move, pause in zip(
            first if repeated or number == 0 else cycle(), times, pauses, strict=True
        ):
            s = np.arange(int(move * rate)) / int(move * rate)
            course = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
            pieces += [
                now[:, None] + np.outer(target - now, course),
                np.repeat(target[:, None], int(pause * rate), axis=1),
            ]
            now = target
    pieces.append(np.repeat(now[:, None], int(rng.uniform(0.0, 2.0) * rate), axis=1))
    q = np.concatenate(pieces, axis=1)
    which = rng.permutation(joints)[:still]
    carriers = np.setdiff1d(np.arange(joints), which)
    if len(carriers):
        push = PUSHED * rng.uniform(-1.0, 1.0, (still, len(carriers)))
        q[which] = middle[which, None] + push @ (q[carriers] - middle[carriers, None])
    else:
        q[which] = middle[which, None]
    bit = rng.choice(BITS)
    noise = bit * rng.choice([0.1, 1.0, 5.0]) * rng.standard_normal(q.shape)
    length = sum(int(m * rate) + int(p * rate) for m, p in zip(times, pauses, strict=True)) / rate
    return ProcessLog(bit * np.round((q + noise) / bit), rate, still, length, count)
