"""Zero code on invented robots, beside the best configuration that is known for each.

Random arms of 3 to 8 joints, some prismatic, with a model file whose masses, centres and inertias
are off by 10 to 60 %. Friction is Coulomb and viscous, or has one law more that the default model
does not know. Encoders, rates and noise of efforts are drawn too. "Zero code" is what `init` writes
with Coulomb and viscous friction; `auto` is that file with `friction = "auto"`; the best that is
known is the same file with the true friction laws, or one of these two where it is better. Errors
are of the measured efforts of another motion, mean over joints, as `identify --validate` prints
them. `python -m proofs.estimation.invented_robots N` takes N robots.
"""

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import polars as pl
from proofs.checks.clean_logs import nominal
from proofs.checks.two_faults import run
from proofs.support.claims import Claim, main_of
from proofs.support.safety_robots import arm_urdf, random_arm

from steelyard.base.errors import SteelyardError
from steelyard.base.motion import Motion
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.identify.identify import identify
from steelyard.model.laws.friction_over_speed import Coulomb, Quadratic, Root, Stribeck, Viscous
from steelyard.model.laws.friction_with_memory import Dahl, LoadDependent
from steelyard.model.laws.laws_without_friction import Offset, RigidBody, RotorInertia
from steelyard.model.laws.register import description_of
from steelyard.model.terms.term import Term
from steelyard.robot.file.robot_file import load_robot
from steelyard.simulate.ground_truth import random_truth

ROBOTS, PROCESSES = 30, 2
OFF = (0.1, 0.6)
INSIDE = 1.05
"""Ratio to the best configuration that is claimed where the default model knows the friction."""

RIGID: tuple[Term, ...] = (RigidBody(), RotorInertia(), Offset())
FRICTION: tuple[tuple[Term, ...], ...] = (
    (Coulomb(), Viscous()),
    (Coulomb(), Viscous(), Stribeck(speed=0.1)),
    (Coulomb(), Viscous(), Root()),
    (Coulomb(), Viscous(), Quadratic()),
    (Dahl(length=3e-3), Viscous()),
    (Coulomb(), Viscous(), LoadDependent(length=1e-3)),
)


@dataclass(frozen=True)
class Outcome:
    """Errors [%] of one robot; infinite where `identify` refused."""

    robot: int
    laws: str
    zero: float
    auto: float
    best: float
    why: str = ""


def logged(motion: Motion, torque: np.ndarray, rng: np.random.Generator, path: Path) -> np.ndarray:
    """What drawn sensors write of a motion; the efforts."""
    resolution = 2.0 * np.pi / 2.0 ** rng.integers(15, 20)
    noise = rng.uniform(0.005, 0.05) * torque.std(axis=0)
    q = np.round(motion.q / resolution) * resolution
    tau = torque + noise * rng.standard_normal(torque.shape)
    columns = {"time": motion.t}
    for name, values in (("position", q), ("effort", tau)):
        columns |= {f"{name}_{k}": values[:, k] for k in range(values.shape[1])}
    pl.DataFrame(columns).write_parquet(path)


def one_of(folder: Path, number: int) -> Outcome:
    """One robot."""
    rng = np.random.default_rng(48_000 + number)
    arm = random_arm(rng, False, (3, 8))
    laws = FRICTION[rng.integers(len(FRICTION))]
    there = folder / str(number)
    there.mkdir()
    for name, one in (("true", arm), ("arm", nominal(arm, float(rng.uniform(*OFF)), rng))):
        (there / f"{name}.urdf").write_text(arm_urdf(one))
    robot = load_robot(there / "true.urdf").robot
    truth = random_truth(robot, number, spread=0.0, terms=(*RIGID, *laws))
    valued, rate = truth.model.at(truth.values), float(rng.choice([100.0, 250.0, 500.0]))
    for k, name in enumerate(("fit", "unseen")):
        path = random_fourier(robot, seed=10 * number + k, period=20.0 - 10.0 * k, harmonics=10)
        motion = path.sample(np.arange(0.0, 20.0 - 10.0 * k, 1.0 / rate))
        logged(motion, valued.torque(motion), rng, there / f"{name}.parquet")
    run("init", there / "arm.urdf", there / "fit.parquet", "-o", there / "zero.toml")
    text = (there / "zero.toml").read_text()
    (there / "zero.toml").write_text(_with_terms(text, (*RIGID, *FRICTION[0]), ""))

    def error(file: str) -> float:
        found = identify(
            there / f"{file}.toml",
            there / "fit.parquet",
            there / "unseen.parquet",
            threads=1,
            check=file == "zero",
        )
        return float(np.mean([joint.relative_percent for joint in found.content.scores[0].joints]))

    name = " + ".join(law.law for law in laws)
    try:
        zero = error("zero")
    except SteelyardError as refused:
        return Outcome(number, name, np.inf, np.inf, 1.0, str(refused).splitlines()[0])
    (there / "best.toml").write_text(_with_terms(text, (*RIGID, *laws), ""))
    (there / "auto.toml").write_text(_with_terms(text, RIGID, 'friction = "auto"'))
    auto = error("auto")
    return Outcome(number, name, zero, auto, min(zero, auto, error("best")))


def _with_terms(text: str, terms: Sequence[Term], more: str) -> str:
    """The robot file with other causes of torque."""
    described = ", ".join(_inline(term) for term in terms)
    lines = [x for x in text.splitlines() if not x.startswith(("terms = ", "friction = "))]
    place = lines.index("[model]") + 1
    return "\n".join([*lines[:place], f"terms = [{described}]", more, *lines[place:]])


def _inline(term: Term) -> str:
    """A term with its length or speed."""
    table = description_of(term)
    kept = {k: v for k, v in table.items() if k in ("length", "speed")}
    fields = "".join(f", {k} = {v}" for k, v in kept.items())
    return f'{{law = "{table["law"]}"{fields}}}'


def main(count: int = ROBOTS) -> list[Claim]:
    """The ratios."""
    with tempfile.TemporaryDirectory() as folder, get_context("spawn").Pool(PROCESSES) as pool:
        found = []
        for one in pool.imap(partial(one_of, Path(folder)), range(count)):
            found.append(one)
            line = f"{one.zero:8.2f} {one.auto:8.2f} {one.best:8.2f} %"
            print(f"{one.robot:4} {line}  {one.laws} {one.why}", file=sys.stderr, flush=True)
    refused = [one for one in found if not np.isfinite(one.zero)]
    known = [one for one in found if np.isfinite(one.zero)]
    inside = [one.zero / one.best for one in known if one.laws == "coulomb + viscous"]
    name, claims = f"{count} invented robots", []
    for what in ("zero", "auto"):
        ratios = np.array([getattr(one, what) / one.best for one in known])
        summary = f"median {np.median(ratios):.3f}, 90 % below {np.quantile(ratios, 0.9):.2f}, "
        claims.append(
            Claim(
                f"{name}, {what} over the best",
                f"{summary}worst {ratios.max():.2f}",
                "reported",
                True,
            )
        )
    worst = max(inside, default=1.0)
    claims += [
        Claim(
            f"{name}, zero code over the best, friction of the default model",
            f"worst of {len(inside)}: {worst:.3f}",
            f"<= {INSIDE}",
            worst <= INSIDE,
        ),
        Claim(f"{name}, sound logs refused", f"{len(refused)}", "0", not refused),
    ]
    return claims


if __name__ == "__main__":
    main_of(lambda: main(int(sys.argv[1]) if len(sys.argv) > 1 else ROBOTS))
