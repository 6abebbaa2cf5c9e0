"""Legged robots from simulated logs: whole bodies with a floating base, contacts measured.

An A1 that sways on its feet and trots is fitted, and predicted in another gait; with 2 kg on its
back it is fitted anew. A G1 hangs on a hoist whose force is measured, or is not. Bodies are not
those of the model file, by 15 % in mass and 1 cm in their centres.
"""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, data_folder, main_of
from proofs.support.legged_robots import LEGGED, Simulation

import steelyard
from steelyard.base.arrays import Array, Parameters
from steelyard.estimate.scores.score import RunScore, score

SECONDS, LOAD = 15.0, 2.0
COVERED = 93.0  # share of the 95 % intervals that hold the truth, at least [%]
WORSE = 1.05  # error on the unseen log over that of the true values, at most


@dataclass(frozen=True, eq=False)
class Trial:
    """Logs of a simulated robot, the last one unseen, and its robot file."""

    simulation: Simulation
    logs: list[Path]
    file: Path

    def true_values(self, model: steelyard.Model) -> Array:
        """The true standard parameters."""
        truth = self.simulation.truth(model.robot)
        return np.array([truth.get(name, 0.0) for name in model.names])


def trial(name: str, folder: Path, trots: list[float], load: float = 0.0, more: str = "") -> Trial:
    """Logs of one robot at gaits [Hz], zero for sways."""
    robot, folder = LEGGED[name], Path(tempfile.mkdtemp(dir=folder))
    path = data_folder().parent / "models" / robot.file
    logs = [folder / f"log{seed}.parquet" for seed in range(len(trots))]
    for seed, (log, trot) in enumerate(zip(logs, trots, strict=True)):
        simulation = Simulation(path, robot, 0, load)
        simulation.log(log, SECONDS, seed, trot)
    return Trial(simulation, logs, simulation.robot_file(folder, path, more))


def identified(tried: Trial, method: str) -> steelyard.Identification:
    """The model of all logs but the last, on which it is scored."""
    *fitted, unseen = tried.logs
    return steelyard.identify(tried.file, fitted, unseen, method=method)


def pooled(of_run: RunScore) -> float:
    """Root mean square error of the joints [Nm]."""
    errors = [joint.error for joint in of_run.errors.joints[6:]]
    return float(np.sqrt(np.mean(np.square(errors))))


def claims_of(name: str, tried: Trial, method: str) -> Iterator[Claim]:
    """Total mass, error on the unseen log, and what intervals cover, of one estimate."""
    found = identified(tried, method)
    model, estimate = found.model, found.model.estimate
    values = tried.true_values(model.model)
    mass, half = total_mass(found)
    true = float(tried.simulation.model.body_mass.sum())
    off = abs(mass - true)
    what = f"{name}, {method}"
    yield Claim(f"{what}: total mass", f"{mass:.3f} kg", f"{true:.3f} ± {half:.3f}", off <= half)
    (run,) = steelyard.load_runs(tried.file, tried.logs[-1])
    exact = model.model.at(Parameters(model.model.names, model.model.units, values))
    best = pooled(score(exact, run, model.signals.gains, model.cutoffs.score))
    error = pooled(found.content.scores[0])
    bound = f"<= {WORSE:g} x {best:.3f} Nm"
    yield Claim(f"{what}: error, unseen", f"{error:.3f} Nm", bound, error <= WORSE * best)
    lifted = dict(zip(model.base.base_names, model.base.base_values(values), strict=True))
    each = zip(
        estimate.parameters.names, estimate.parameters.values, estimate.half_width, strict=True
    )
    inside = [abs(x - lifted[n]) <= h for n, x, h in each if h > 0.0]
    share = 100.0 * float(np.mean(inside))
    yield Claim(
        f"{what}: within 95 % intervals, of {len(inside)}",
        f"{share:.0f} %",
        f">= {COVERED:g} %",
        share >= COVERED,
    )


def total_mass(found: steelyard.Identification) -> tuple[float, float]:
    """The base's mass is grouped with that of all links; half of its 95 % interval [kg]."""
    estimate = found.model.estimate
    place = list(estimate.parameters.names).index(f"m.{found.model.robot.bodies[0].name}")
    return float(estimate.parameters.values[place]), float(estimate.half_width[place])


def main() -> list[Claim]:
    """Both robots."""
    claims = list[Claim]()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        walking = trial("A1", folder, [0.0, 2.0, 3.0])
        for method in ("least_squares", "consistent"):
            claims += claims_of("A1 walking", walking, method)
        plain = total_mass(identified(walking, "consistent"))
        carrying = total_mass(identified(trial("A1", folder, [0.0, 2.0, 3.0], LOAD), "consistent"))
        more = carrying[0] - plain[0]
        bound = f"{LOAD:g} ± 0.2 kg"
        claims.append(
            Claim("A1, more on its back", f"{more:.3f} kg", bound, abs(more - LOAD) <= 0.2)
        )
        hung = trial("G1", folder, [0.0, 0.0, 0.0])
        claims += claims_of("G1 on a hoist", hung, "least_squares")
        text = hung.file.read_text()
        hung.file.write_text(text[: text.index("[[signals.base")] + 'wrench = "unknown"\n')
        alone = identified(hung, "least_squares")
        names = alone.model.estimate.parameters.names
        seen = [name for name in names if name == "m.pelvis"]
        name = "G1, force of the hoist unknown: base mass, error on the unseen log"
        error = pooled(alone.content.scores[0])
        claims.append(
            Claim(name, f"{'seen' if seen else 'not seen'}, {error:.3f} Nm", "not seen", not seen)
        )
    return claims


if __name__ == "__main__":
    main_of(main)
