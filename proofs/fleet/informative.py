"""Eight hours of pick and place: the few windows that say as much as all of them.

A Panda moves between places of a few pallets, minimum-jerk moves of one to three seconds, with a
load of 1.2 kg in half of them; every hour one move is another one (a tool change). A model that was
identified before chooses windows; from them, and from all windows, parameters are estimated by
weighted least squares, and judged on a motion of another kind.
`python -m proofs.fleet.informative HOURS` takes fewer.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import polars as pl
from proofs.support import simulated_fleet as simulated
from proofs.support.claims import Claim, main_of

import steelyard
from steelyard.base.arrays import Array
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares

HOURS, RATE = 8.0, 100.0
LOAD = 1.2  # [kg]
MOST_WINDOWS, LEAST_SHARE, MOST_WORSE = 0.05, 0.95, 1.05


def places(rng: np.random.Generator) -> Array:
    """Twelve places above two pallets and a feeder, `(12, 7)` [rad]."""
    middle = np.array([0.0, 0.3, 0.0, -1.9, 0.0, 2.1, 0.7])
    pallets = np.array([[-0.8, 0.1, 0, 0, 0, 0, 0], [0.7, -0.1, 0, 0.1, 0, 0, 0], np.zeros(7)])
    each = rng.normal(0.0, 0.12, (12, 7)) * np.array([1, 1, 0.3, 1, 0.3, 1, 1.5])
    return np.asarray(middle + pallets[np.arange(12) % 3] + each)


def moved(start: Array, goal: Array, seconds: float) -> tuple[Array, Array, Array]:
    """A minimum-jerk move, `(N, 7)` each."""
    s = np.arange(0.0, 1.0, 1.0 / (seconds * RATE))[:, None]
    way = goal - start
    q = start + way * (10 * s**3 - 15 * s**4 + 6 * s**5)
    dq = way * (30 * s**2 - 60 * s**3 + 30 * s**4) / seconds
    return q, dq, way * (60 * s - 180 * s**2 + 120 * s**3) / seconds**2


def day(hours: float, seed: int) -> dict[str, Array]:
    """The log of production."""
    rng = np.random.default_rng(seed)
    known, at = places(rng), np.array([0.0, 0.3, 0.0, -1.9, 0.0, 2.1, 0.7])
    parts, loads, length, hour = [], [], 0, 0
    while length < 3600.0 * RATE * hours:
        carries = len(parts) % 2 == 1
        goal, seconds = known[rng.integers(12)], rng.uniform(1.0, 3.0)
        if length > 3600.0 * RATE * (hour + 0.5):
            hour, carries, seconds = hour + 1, False, 3.0
            goal = at + rng.normal(0.0, 0.8, 7) * np.array([1.0, 0.5, 1.0, 0.4, 1.0, 0.6, 1.0])
        part = moved(at, goal, seconds)
        parts.append(part)
        loads.append(np.full(len(part[0]), carries))
        at, length = goal, length + len(part[0])
    q, dq, ddq = (np.concatenate(x) for x in zip(*parts, strict=True))
    return logged(q, dq, ddq, np.concatenate(loads), rng)


def logged(
    q: Array, dq: Array, ddq: Array, loaded: Array, rng: np.random.Generator
) -> dict[str, Array]:
    empty, model = simulated.bodies(), simulated.bodies().copy()
    model.inertias[7] = model.inertias[7] + pin.Inertia(
        LOAD, np.array([0, 0, 0.1]), 0.002 * np.eye(3)
    )
    data = empty.createData(), model.createData()
    tau = np.array([
        pin.rnea((empty, model)[int(k)], data[int(k)], *x)
        for k, *x in zip(loaded, q, dq, ddq, strict=True)
    ])  # fmt: skip
    tau += np.array(simulated.COULOMB) * np.sign(dq) + np.array(simulated.VISCOUS) * dq
    found = {"t": np.arange(len(q)) / RATE}
    for name, x, size in zip(("q", "dq", "tau"), (q, dq, tau), simulated.NOISE, strict=True):
        noisy = x + size * rng.normal(size=x.shape)
        found |= {f"{name}{j + 1}": noisy[:, j] for j in range(7)}
    return found


def exciting(seed: int) -> dict[str, Array]:
    """A log of a designed motion, without load."""
    t, q, dq, ddq = simulated.motion(seed)
    return logged(q, dq, ddq, np.zeros(len(t), dtype=bool), np.random.default_rng(seed))


def main(hours: float = HOURS) -> list[Claim]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "arm.toml").write_text(simulated.ROBOT_FILE.format(urdf=simulated.urdf()))
        for seed, log in ((0, "fit"), (1, "unseen")):
            pl.DataFrame(exciting(seed)).write_parquet(folder / f"{log}.parquet")
        pl.DataFrame(day(hours, 2)).write_parquet(folder / "production.parquet")
        model = steelyard.identify(folder / "arm.toml", folder / "fit.parquet").model
        chosen = steelyard.informative_stretches(model, folder / "production.parquet")
        errors = []
        for information in (chosen.information, chosen.all_information):
            found = replace(model, estimate=WeightedLeastSquares()(information))
            unseen = steelyard.validate(found, folder / "unseen.parquet")
            errors.append(float(np.mean(unseen.scores["error"].to_numpy())))
    share = chosen.chosen / chosen.windows
    return [
        Claim(f"windows of {hours:g} h of pick and place that are chosen",
              f"{share:.1%} of {chosen.windows}; {chosen.unexplained} left out",
              f"<= {MOST_WINDOWS:.0%}", share <= MOST_WINDOWS),
        Claim("what they hold of log det", f"{chosen.share:.1%}", f">= {LEAST_SHARE:.0%}",
              chosen.share >= LEAST_SHARE),
        Claim("error on another motion over that of all windows",
              f"{errors[0]:.3f} % over {errors[1]:.3f} %", f"<= {MOST_WORSE:g}",
              errors[0] <= MOST_WORSE * errors[1]),
    ]  # fmt: skip


if __name__ == "__main__":
    main_of(lambda: main(*map(float, sys.argv[1:2])))
