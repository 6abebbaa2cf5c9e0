"""Logs of legged robots, models fitted to them, and what these are compared with."""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, data_folder
from proofs.support.legged_robots import LEGGED, Simulation

import steelyard
from steelyard.base.arrays import Array, Parameters
from steelyard.estimate.scores.score import RunScore, score
from steelyard.identify.fit_preparation import with_signals

SECONDS = 15.0  # of each log
WORSE = 1.05  # error on the unseen log over that of the true values, at most


@dataclass(frozen=True, eq=False)
class Trial:
    """Logs of a simulated robot, the last one unseen, and its robot files.

    `flags` is one with contacts whose forces are not measured; none of a robot that hangs.
    """

    simulation: Simulation
    logs: list[Path]
    file: Path
    flags: Path | None

    def true_values(self, model: steelyard.Model) -> Array:
        """The true standard parameters."""
        truth = self.simulation.truth(model.robot)
        return np.array([truth.get(name, 0.0) for name in model.names])


def trial(
    name: str,
    folder: Path,
    trots: Sequence[float],
    load: float = 0.0,
    draw: int = 0,
    mirrored: bool = False,
) -> Trial:
    """Logs of one robot at gaits [Hz], zero for sways; bodies and noise by the number of a draw."""
    robot, folder = LEGGED[name], Path(tempfile.mkdtemp(dir=folder))
    path = data_folder().parent / "models" / robot.file
    logs = [folder / f"log{seed}.parquet" for seed in range(len(trots))]
    for seed, (log, trot) in enumerate(zip(logs, trots, strict=True)):
        simulation = Simulation(path, robot, draw, load, mirrored)
        simulation.log(log, SECONDS, 1000 * draw + seed, trot)
    written = partial(simulation.robot_file, folder, path)
    return Trial(simulation, logs, written(), None if robot.hung else written(measured=False))


def identified(tried: Trial, method: str, file: Path | None = None) -> steelyard.Identification:
    """The model of all logs but the last, on which it is scored."""
    *fitted, unseen = tried.logs
    return steelyard.identify(file or tried.file, fitted, unseen, method=method)


def pooled(of_run: RunScore) -> float:
    """Root mean square error of the joints [Nm]."""
    errors = [joint.error for joint in of_run.errors.joints[6:]]
    return float(np.sqrt(np.mean(np.square(errors))))


def errors_unseen(
    tried: Trial, found: steelyard.Identification, file: Path | None = None
) -> tuple[float, float]:
    """Errors of a model and of the true values on the unseen log [Nm]."""
    model = found.model
    (run,) = steelyard.load_runs(file or tried.file, tried.logs[-1])
    run = with_signals(run, model.signals)  # the same columns
    values = tried.true_values(model.model)
    exact = model.model.at(Parameters(model.model.names, model.model.units, values))
    best = pooled(score(exact, run, model.signals.gains, model.cutoffs.score))
    return pooled(found.content.scores[0]), best


def intervals(model: steelyard.IdentifiedModel) -> Mapping[str, tuple[float, float]]:
    """Each base parameter with half of its 95 % interval, if that is known."""
    estimate = model.estimate
    values = zip(
        estimate.parameters.names, estimate.parameters.values, estimate.half_width, strict=True
    )
    return {name: (float(x), float(half)) for name, x, half in values if half > 0.0}


def covered(tried: Trial, found: steelyard.Identification) -> list[bool]:
    """Whether the 95 % interval of each base parameter holds the true value."""
    model = found.model
    true = model.base.base_values(tried.true_values(model.model))
    lifted = dict(zip(model.base.base_names, true, strict=True))
    return [abs(x - lifted[name]) <= half for name, (x, half) in intervals(model).items()]


def total_mass(found: steelyard.Identification) -> tuple[float, float]:
    """The base's mass is grouped with that of all links; half of its 95 % interval [kg]."""
    return intervals(found.model)[f"m.{found.model.robot.bodies[0].name}"]


def claims_of(
    name: str, tried: Trial, found: steelyard.Identification, least: float, file: Path | None = None
) -> Iterator[Claim]:
    """Total mass, error on the unseen log, and what intervals cover, of one estimate [%]."""
    mass, half = total_mass(found)
    true = float(tried.simulation.model.body_mass.sum())
    off = abs(mass - true)
    yield Claim(f"{name}: total mass", f"{mass:.3f} kg", f"{true:.3f} ± {half:.3f}", off <= half)
    error, best = errors_unseen(tried, found, file)
    bound = f"<= {WORSE:g} x {best:.3f} Nm"
    yield Claim(f"{name}: error, unseen", f"{error:.3f} Nm", bound, error <= WORSE * best)
    inside = covered(tried, found)
    share = 100.0 * float(np.mean(inside))
    what = f"{name}: within 95 % intervals, of {len(inside)}"
    yield Claim(what, f"{share:.0f} %", f">= {least:g} %", share >= least)
