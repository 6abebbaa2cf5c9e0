"""Zero code on simulated arms and hands: what 95 % intervals cover, by kind of parameter.

For each robot: `init` writes the robot file, `excite` designs the motion, `simulate` draws a robot
and writes its logs, `check` and `identify` follow, with another motion to be predicted. Robots come
from the folder `models` beside the one that STEELYARD_DATA names, and from the folders of
STEELYARD_MODELS (`python -m proofs.models.model_files --fetch FOLDER` fills one); meshes are not
needed.
"""

import json
import re
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from proofs.checks.two_faults import run
from proofs.support.claims import Claim, main_of
from proofs.support.model_files import folders

from steelyard.base.arrays import Z95
from steelyard.base.errors import SteelyardError
from steelyard.estimate.identified_model import load_model
from steelyard.identify.identify import identify

DRAWS, PROCESSES = 2, 2

SHARE = "cmeel.prefix/share/example-robot-data/robots"

ROBOTS = {
    "aloha": "menagerie/aloha/aloha.xml",
    "allegro": "menagerie/wonik_allegro/right_hand.xml",
    "panda": "panda_description/urdf/panda.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "xarm7": "menagerie/ufactory_xarm7/xarm7_nohand.xml",
    "ur5e": "menagerie/universal_robots_ur5e/ur5e.xml",
    "ur10e": "menagerie/universal_robots_ur10e/ur10e.xml",
    "fr3": "menagerie/franka_fr3/fr3.xml",
    "gen3": "menagerie/kinova_gen3/gen3.xml",
    "z1": "menagerie/unitree_z1/z1.xml",
    "vx300s": "menagerie/trossen_vx300s/vx300s.xml",
    "piper": "menagerie/agilex_piper/piper.xml",
    "ur3": "ur_description/urdf/ur3_robot.urdf",
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "jaco": "kinova_description/robots/kinova.urdf",
    "iiwa": "pybullet/pybullet_data/kuka_iiwa/model.urdf",
    "xarm6": "pybullet/pybullet_data/xarm/xarm6_robot.urdf",
    "sawyer": "robosuite/robosuite/models/assets/robots/sawyer/robot.xml",
    "ur3e": "airo_models/airo_models/arms/ur3e/ur3e.urdf",
    "so101": f"example_robot_data/{SHARE}/so_arm_description/urdf/so101.urdf",
}

OWN = ("aloha", "allegro")
"""Robots with claims of their own; the others are pooled."""

KINDS = ("coulomb", "viscous", "rotor_inertia", "offset")

BAND = (93.0, 97.0)
"""Bounds of the coverage [%], but for the chance of so many intervals that hold 95 %."""


@dataclass(frozen=True)
class Outcome:
    """One draw of one robot; without errors and coverage where `why` says what refused it."""

    robot: str
    inside: dict[str, list[bool]]
    error: float = float("nan")
    why: str = ""


def source_of(name: str) -> Path | None:
    """The robot's published file, where it is there."""
    places = (folder / ROBOTS[name] for folder in folders())
    return next((path for path in places if path.is_file()), None)


def model_of(name: str, folder: Path) -> Path:
    """The robot's model; Allegro's, whose masses are those of meshes, with those of boxes."""
    source = source_of(name)
    assert source is not None
    if name != "allegro":
        return source
    path, meshes = folder / source.name, r'<geom class="\w*visual".*/>| mass="0"'
    path.write_text(re.sub(meshes, "", source.read_text()))
    return path


def prepared(name: str, folder: Path) -> tuple[Path, list[object]]:
    """The robot file that `init` writes, and how `simulate` is given the motion of `excite`.

    Where `excite` finds none, it takes a random one.
    """
    robot, motion = folder / f"{name}.toml", folder / f"{name}-motion"
    done("init", model_of(name, folder), "-o", robot)
    try:
        done("excite", robot, "-o", motion, "--budget", 10, "--processes", 1)
    except RuntimeError as error:
        print(f"{name:<10} random motion: {error}", file=sys.stderr)
        return robot, ["--period", 20]
    return robot, ["--motion", motion / "trajectory.json", "--periods", 2]


def done(*arguments: object) -> None:
    """Run a command.

    Raises:
        RuntimeError: The command failed.
    """
    code, output = run(*arguments)
    if code not in (0, 1, 3):
        raise RuntimeError(f"{arguments[0]}: {output.strip().splitlines()[0]}")


def draws_of(name: str, folder: Path, draws: int) -> list[Outcome]:
    """All draws of one robot; each is printed when it is there."""
    robot, motion = prepared(name, folder)
    found = []
    for seed in range(draws):
        found.append(one_of(folder, robot, motion, seed))
        print(line(found[-1]), file=sys.stderr, flush=True)
    return found


def one_of(folder: Path, robot: Path, motion: list[object], seed: int) -> Outcome:
    """One draw."""
    name = robot.stem
    there = folder / f"{name}-{seed}"
    fitted, unseen = (there.with_name(f"{there.name}-{what}") for what in ("fit", "unseen"))
    try:
        done("simulate", robot, *motion, "--seed", seed, "-o", fitted)
        other = there.with_name(f"{there.name}-other")
        done("simulate", robot, "--seed", seed + 1000, "-o", other)
        done("simulate", robot, "--motion", other / "trajectory.json", "--seed", seed, "-o", unseen)
        done("check", robot, fitted / "log.csv")
        logs = fitted / "log.csv", unseen / "log.csv"
        found = identify(robot, *logs, threads=1)
        found.save(there)
    except (SteelyardError, RuntimeError) as error:
        return Outcome(name, {}, why=str(error).splitlines()[0])
    errors = [joint.relative_percent for joint in found.content.scores[0].joints]
    inside = covered(there / "model.json", fitted / "truth.json")
    return Outcome(name, inside, float(np.mean(errors)))


def covered(model: Path, truth: Path) -> dict[str, list[bool]]:
    """Which 95 % intervals hold the truth, by kind."""
    identified, known = load_model(str(model)), json.loads(truth.read_text())["parameters"]
    base, estimate = identified.base, identified.estimate
    values = base.base_values(np.array([known[name]["value"] for name in base.names]))
    true = dict(zip(base.base_names, values, strict=True))
    found: dict[str, list[bool]] = defaultdict(list)
    parameters = estimate.parameters
    for name, value, std in zip(parameters.names, parameters.values, estimate.std, strict=True):
        kind = name.split(".")[0]
        holds = abs(value - true[name]) <= Z95 * std
        found[kind if kind in KINDS else "bodies"].append(bool(holds))
    return dict(found)


def line(outcome: Outcome) -> str:
    """One draw in words."""
    if outcome.why:
        return f"{outcome.robot:<10} {outcome.why}"
    parts = [f"{kind} {share(inside):.0f} %" for kind, inside in sorted(outcome.inside.items())]
    return f"{outcome.robot:<10} error {outcome.error:.2f} %, " + ", ".join(parts)


def share(inside: list[bool]) -> float:
    """Percentage of what holds."""
    return 100.0 * float(np.mean(inside))


def claims_of(name: str, outcomes: list[Outcome]) -> Iterator[Claim]:
    """Coverage of some robots, by kind of parameter."""
    for kind in ("coulomb", "viscous", "rotor_inertia", "bodies"):
        inside = [x for one in outcomes for x in one.inside.get(kind, [])]
        value = share(inside) if inside else float("nan")
        chance = Z95 * 100.0 * float(np.sqrt(0.05 * 0.95 / max(len(inside), 1)))
        bound = f"{BAND[0]:g} to {BAND[1]:g} %, ± {chance:.1f}"
        holds = BAND[0] - chance <= value <= BAND[1] + chance
        yield Claim(f"{name}, intervals, {kind}", f"{value:.1f} % of {len(inside)}", bound, holds)
    refused = [one for one in outcomes if one.why]
    errors = [one.error for one in outcomes if not one.why]
    median = f"{np.median(errors):.2f} %" if errors else "none"
    yield Claim(f"{name}, error of unseen motion, median", median, "reported", True)
    yield Claim(f"{name}, draws refused", f"{len(refused)} of {len(outcomes)}", "0", not refused)


def main(draws: int = DRAWS, only: tuple[str, ...] = ()) -> list[Claim]:
    """Arms pooled, then the others."""
    with tempfile.TemporaryDirectory() as folder, get_context("spawn").Pool(PROCESSES) as pool:
        names = [name for name in ROBOTS if not only or name in only]
        for name in [n for n in names if source_of(n) is None]:
            print(f"{name:<10} left out: no {ROBOTS[name]}", file=sys.stderr)
            names.remove(name)
        drawn = partial(draws_of, folder=Path(folder), draws=draws)
        found = [one for some in pool.imap_unordered(drawn, names) for one in some]
    groups = {"arms": [one for one in found if one.robot not in OWN]}
    groups |= {name: [one for one in found if one.robot == name] for name in OWN}
    return [claim for name, some in groups.items() if some for claim in claims_of(name, some)]


def _of_command_line() -> list[Claim]:
    from argparse import ArgumentParser

    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=DRAWS, help="robots drawn per model")
    parser.add_argument("--only", nargs="*", default=(), choices=ROBOTS, help="models")
    given = parser.parse_args()
    return main(given.draws, tuple(given.only))


if __name__ == "__main__":
    main_of(_of_command_line)
