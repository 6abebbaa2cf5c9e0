"""Two cases on real UR10e logs that once ended in a wrong model with confident words.

Motor currents with a robot file as `steelyard init` writes it (every gain 1), and the same logs
with columns in ROS's alphabetical order, currents declared as torques. Each ends in the right model
or in a refusal with the right reason, and every way that a refusal names leads to a model.
"""

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from proofs.support.claims import Claim, data_folder, main_of
from typer.testing import CliRunner

from steelyard.cli.app import app
from steelyard.robot.file.toml_schema import tomllib

CONTROLLER = np.array([11.98, 11.98, 9.83, 10.76, 10.76, 10.76])
"""Slope of the controller's target moment over its target current in static postures [Nm/A]."""
LOGS = ("05-20sec_8harm", "10-30sec_12harm")
UNLOADED, LOADED, MASS = "19_14harm50sec", "19_14harm50secLoad", 2.805
ALPHABETICAL = [3, 2, 1, 4, 5, 6]
EXAMPLE = Path(__file__).parents[2] / "examples" / "ur10e.toml"


def run(*arguments: object) -> tuple[int, str]:
    """Exit code and output of a command."""
    done = CliRunner().invoke(app, [str(a) for a in arguments])
    return done.exit_code, done.output + done.stderr


def log_of(name: str) -> Path:
    """An excitation log."""
    return data_folder() / "ur10e" / "identification" / f"ur-20_02_{name}.parquet"


def without_targets(folder: Path, name: str) -> Path:
    """The log with measured columns only."""
    table, path = pl.read_parquet(log_of(name)), folder / f"{name}.parquet"
    table.select([c for c in table.columns if "_des" not in c]).write_parquet(path)
    return path


def of_ros(folder: Path, name: str) -> Path:
    """The log in ROS's order, currents as efforts."""
    table, path = pl.read_parquet(log_of(name)), folder / f"{name}.parquet"
    columns = {"time": table["time_s"]}
    for kind, pattern in (("position", "q{}_rad"), ("effort", "current{}_A")):
        for k, joint in enumerate(ALPHABETICAL):
            columns[f"{kind}_{k}"] = table[pattern.format(joint)]
    pl.DataFrame(columns).write_parquet(path)
    return path


def effort_of(path: Path) -> dict[str, Any]:
    """`[signals.effort]` of a robot file."""
    found: dict[str, Any] = tomllib.loads(path.read_text())["signals"]["effort"]
    return found


def of_one(robot: Path) -> Path:
    """A robot file that `init` wrote with gains of 1 and the friction laws of the example."""
    text = robot.read_text().replace('friction = "auto"\n', "")
    text = text.replace(
        '"rotor_inertia", "offset"', '"rotor_inertia", "coulomb", "viscous", "offset"'
    )
    robot.write_text(text)
    return with_gain(robot, [1.0] * 6, "ones.toml")


def with_gain(robot: Path, gain: object, name: str) -> Path:
    """A robot file with other gains."""
    lines = robot.read_text().split("\n")
    changed = [f"gain = {json.dumps(gain)}" if x.startswith("gain = ") else x for x in lines]
    path = robot.parent / name
    path.write_text("\n".join(changed))
    return path


def torques(folder: Path) -> np.ndarray:
    """Torques of an identified model along a motion of its own, shape `(N, n)`."""
    from steelyard.estimate.identified_model import load_model
    from steelyard.excite.trajectories.fourier import random_fourier

    model = load_model(str(folder / "model.json"))
    trajectory = random_fourier(model.model.robot, seed=1, period=10.0)
    return model.torque(trajectory.sample(np.arange(0.0, 10.0, 0.02)))


def currents(folder: Path) -> list[Claim]:
    """Currents, gains of 1."""
    urdf, logs = data_folder() / "ur10e" / "ur10e.urdf", [log_of(n) for n in LOGS]
    drafted, fixed = folder / "ur10e.toml", folder / "fixed.toml"
    run("init", urdf, logs[0], "-o", drafted)
    robot = of_one(drafted)
    code, output = run("identify", robot, *logs, "-o", folder / "refused")
    run("check", robot, *logs, "--fix", fixed)
    gains = effort_of(fixed)["gain"]
    pairs = [(g, c) for g, c in zip(gains, CONTROLLER, strict=True) if g != "identify"]
    worst = max(abs(g / c - 1.0) for g, c in pairs)
    full = with_gain(fixed, [g if g != "identify" else 10.76 for g in gains], "full.toml")
    done = run("identify", full, *logs, "--validate", log_of(UNLOADED), "-o", folder / "full")[0]
    run("identify", EXAMPLE, *logs, "-o", folder / "example")
    mine, wanted = torques(folder / "full"), torques(folder / "example")
    error = float(np.linalg.norm(mine - wanted) / np.linalg.norm(wanted))
    return [
        Claim(
            "UR10e, gains of 1: identify",
            f"exit code {code}, {output.split(':')[1].strip() if ':' in output else output}",
            "refused for gains, no model",
            code == 2 and "gain" in output and not (folder / "refused").exists(),
        ),
        Claim(
            "UR10e, gains of 1: gains written by check --fix",
            f"{gains}, off by at most {100.0 * worst:.1f} %",
            "at least 4, within 2 % of the controller's, the others to be identified",
            len(pairs) >= 4 and worst <= 0.02,
        ),
        Claim(
            "UR10e with these, wrist 3 from the data sheet: torques",
            f"exit code {done}, {100.0 * error:.1f} % from those with the controller's gains",
            "exit code 0, <= 2 %",
            done == 0 and error <= 0.02,
        ),
    ]


def ways(folder: Path) -> list[Claim]:
    """Without the controller's targets: nothing is written, and the ways lead to models."""
    logs = [without_targets(folder, n) for n in (*LOGS, UNLOADED, LOADED)]
    drafted, fixed = folder / "ur10e.toml", folder / "fixed.toml"
    run("init", data_folder() / "ur10e" / "ur10e.urdf", logs[0], "-o", drafted)
    robot = of_one(drafted)
    code, output = run("check", robot, *logs[:2], "--fix", fixed)
    unknown = with_gain(robot, "identify", "unknown.toml")
    loaded = ["--loaded", logs[3]]
    second = run(
        "identify", unknown, logs[2], *loaded, "--payload-mass", MASS, "--json", "-o", folder / "2"
    )
    found = json.loads(second[1].split("\n")[0])["gains"]["gains"] if second[0] < 2 else [0.0] * 6
    off = float(np.max(np.abs(np.array(found) / CONTROLLER - 1.0)))
    one = with_gain(robot, ["identify", 1.0, *["identify"] * 4], "one.toml")
    third = run("identify", one, logs[2], *loaded, "-o", folder / "3")[0]
    return [
        Claim(
            "UR10e without targets: check --fix",
            f"exit code {code}, {'a file' if fixed.exists() else 'no file'}",
            'exit code 2, no file, "identify" and --payload-mass named',
            code == 2
            and not fixed.exists()
            and '"identify"' in output
            and "--payload-mass" in output,
        ),
        Claim(
            f"UR10e without targets, a load of {MASS} kg: gains",
            f"{[round(g, 2) for g in found]}, off by at most {100.0 * off:.0f} %",
            "within 10 % of the controller's",
            off <= 0.1,
        ),
        Claim(
            "UR10e without targets, a load of unknown mass, one gain of 1",
            f"exit code {third}",
            "a model, up to one scale",
            third < 2 and (folder / "3" / "model.json").is_file(),
        ),
    ]


def alphabetical(folder: Path) -> list[Claim]:
    """ROS's order, currents as efforts."""
    logs = [of_ros(folder, n) for n in LOGS]
    urdf, fixed = data_folder() / "ur10e" / "ur10e.urdf", folder / "fixed.toml"
    first = run("identify", urdf, *logs, "-o", folder / "1")
    code = run("check", urdf, *logs, "--fix", fixed)[0]
    effort = effort_of(fixed)
    position = tomllib.loads(fixed.read_text())["signals"]["position"]
    right = [f"position_{ALPHABETICAL.index(j)}" for j in range(1, 7)]
    second = run("identify", fixed, *logs, "-o", folder / "2")
    ordered = position == right and effort["columns"] == [
        x.replace("position", "effort") for x in right
    ]
    return [
        Claim(
            "UR10e in ROS's order, currents as torques: identify",
            f"exit code {first[0]}, {first[1].split(':')[1].strip()}",
            "refused for the order, no model",
            first[0] == 2 and "joint order" in first[1] and not (folder / "1").exists(),
        ),
        Claim(
            "the same, check --fix",
            f"exit code {code}, order {'right' if ordered else 'wrong'}, gain {effort.get('gain')}",
            "exit code 2 still, right order, no gain",
            code == 2 and ordered and "gain" not in effort,
        ),
        Claim(
            "the same, identify with the fixed file",
            f"exit code {second[0]}, {second[1].split(':')[1].strip()}",
            "refused for the kind of efforts",
            second[0] == 2 and "effort kind" in second[1],
        ),
    ]


def reversed_signs(folder: Path) -> list[Claim]:
    """KUKA med7, whose torques all count against its URDF."""
    robot, data = folder / "fixed.toml", data_folder() / "med7"
    log = data / "med7_measurements.parquet"
    run("check", data / "med7dock.urdf", log, "--quick", "--fix", robot)
    gains = effort_of(robot).get("gain") if robot.exists() else None
    return [
        Claim(
            "med7, torques against the URDF: gains written by check --fix",
            f"{gains}",
            "-1 for all joints",
            gains == [-1.0] * 7,
        )
    ]


def main() -> list[Claim]:
    """Both cases, and a log whose signs are all reversed."""
    claims = []
    for case in (currents, ways, alphabetical, reversed_signs):
        with tempfile.TemporaryDirectory() as folder:
            claims += case(Path(folder))
    return claims


if __name__ == "__main__":
    main_of(main)
