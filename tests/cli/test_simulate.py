"""`steelyard simulate`: motions, payloads, and the causes of torque of the robot file."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from cli.conftest import Command
from cli.mistakes import ROBOT
from steelyard.base.files import write_json
from steelyard.excite.controller_file_formats import write_export
from steelyard.excite.trajectories.exact_trajectories import (
    ChainedMotion,
    PiecewiseMotion,
    SampledMotion,
    SlowedMotion,
)
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.excite.trajectories.trajectory_files import trajectory_from_dict
from steelyard.robot.file.robot_file import load_robot

RUN = ("simulate", ROBOT, "--period", "1.5", "--noise", "0")


def efforts(folder: Path) -> np.ndarray:
    table = pl.read_csv(folder / "log.csv")
    return table.select([name for name in table.columns if name.startswith("tau")]).to_numpy()


@pytest.mark.slow
def test_a_payload_is_carried_between_its_times(command: Command, tmp_path: Path) -> None:
    given = {
        "bare": (),
        "carried": ("--payload-mass", "3", "--attach", "1.2", "--release", "2.0"),
        "elsewhere": ("--payload-mass", "3", "--payload-frame", "forearm"),
    }
    for name, options in given.items():
        done = command(*RUN, *options, "-o", tmp_path / name)
        assert done.exit_code == 0, done.stderr
    bare, carried, elsewhere = (efforts(tmp_path / name) for name in given)
    np.testing.assert_array_equal(carried[:300], bare[:300])
    assert np.abs(carried - bare)[400:500, 1].max() > 5.0
    assert np.abs(carried - bare)[-50:].max() < 0.1
    # a load on the elbow's axis hardly moves the elbow
    apart = np.abs(elsewhere - bare)[250:600].max(axis=0)
    assert apart[1] > 2.0 and apart[2] < 0.3 * apart[1]


def test_payloads_that_cannot_be_are_refused(command: Command, tmp_path: Path) -> None:
    out = ("-o", tmp_path / "o")
    done = command(*RUN, "--payload-mass", "3", "--payload-frame", "tol", *out)
    assert done.exit_code == 2
    assert "there is no frame 'tol'" in done.stderr and "tool" in done.stderr
    done = command(*RUN, "--payload-mass", "3", "--attach", "2", "--release", "1", *out)
    assert done.exit_code == 2 and "attached at 2 s, released at 1 s" in done.stderr
    done = command(*RUN, "--payload-mass", "3", "--attach", "300", *out)
    assert done.exit_code == 2 and "attached at 300 s, but the log ends at" in done.stderr
    assert command(*RUN, "--payload-mass", "0", *out).exit_code == 2
    assert not (tmp_path / "o").exists()


def test_an_option_of_a_payload_needs_its_mass(command: Command, tmp_path: Path) -> None:
    for option in (("--attach", "1"), ("--release", "2"), ("--payload-frame", "tool")):
        done = command(*RUN, *option, "-o", tmp_path / "o")
        assert done.exit_code == 2 and "--payload-mass" in done.stderr


@pytest.mark.parametrize("rate", [33.333, 1.0 / 0.03])
def test_a_log_at_a_rate_that_is_no_whole_number_is_identified(
    rate: float, command: Command, tmp_path: Path
) -> None:
    options = ("--period", 10, "--rate", rate, "--noise", 0, "-o", tmp_path / "run")
    done = command("simulate", ROBOT, *options)
    assert done.exit_code == 0, done.stderr
    t = pl.read_csv(tmp_path / "run" / "log.csv")["time_s"].to_numpy()
    np.testing.assert_allclose(t, np.arange(len(t)) / rate, rtol=0.0, atol=1e-6)
    assert len(t) == int(12.0 * rate + 1e-9) + 1
    log, out = tmp_path / "run" / "log.csv", tmp_path / "out"
    done = command("identify", ROBOT, log, "--no-check", "--method", "WLS", "-o", out, "--json")
    assert done.exit_code == 0, done.stderr
    (joints,) = (run["joints"] for run in json.loads(done.stdout)["identification"])
    assert max(joint["relative_percent"] for joint in joints) < 5.0


def test_causes_of_torque_are_those_of_the_robot_file(
    given: Path, command: Command, tmp_path: Path
) -> None:
    text = (given / "demo_arm.toml").read_text()
    start, stop = text.index("terms = ["), text.index("[signals]")
    terms = 'terms = ["rigid_body", {law = "dahl", length = 1e-3}, {law = "spring", '
    terms += 'joints = ["elbow"]}]\n\n'
    (tmp_path / "demo_arm.urdf").write_text((given / "demo_arm.urdf").read_text())
    (tmp_path / "arm.toml").write_text(text[:start] + terms + text[stop:])
    done = command("simulate", tmp_path / "arm.toml", "--period", "1", "-o", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    truth = json.loads((tmp_path / "out" / "truth.json").read_text())
    laws = {name.split(".")[0] for name in truth["parameters"]}
    assert {"m", "Izz", "dahl", "spring"} < laws and "coulomb" not in laws
    assert [name for name in truth["parameters"] if "spring" in name] == ["spring.elbow"]
    assert truth["terms"][1]["length"] == 1e-3


def positions(log: Path) -> np.ndarray:
    table = pl.read_csv(log)
    return table.select([name for name in table.columns if name.startswith("q")]).to_numpy()


@pytest.fixture
def kinds(given: Path, tmp_path: Path) -> dict[str, Path]:
    """Motions of several kinds as files; `tests/excite/test_exact.py` stores all."""
    robot = load_robot(given / "demo_arm.toml").robot
    fourier = random_fourier(robot, seed=5, period=1.5, harmonics=3)
    t = np.linspace(0.0, 1.5, 151)
    table = SampledMotion(t, fourier.sample(t).q)
    motions = {
        "fourier": fourier,
        "sampled": table,
        "chained": ChainedMotion([fourier, table]),
        "slowed": SlowedMotion(fourier, 0.5),
    }
    files = {kind: tmp_path / f"{kind}.json" for kind in motions}
    for kind, motion in motions.items():
        assert motion.to_dict()["kind"] == kind
        write_json(files[kind], motion.to_dict())
    files["csv"] = write_export(fourier, robot, "csv", tmp_path)
    return files


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sampled", "chained", "slowed", "csv"])
def test_motions_of_every_kind_are_followed(
    kind: str, kinds: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    done = command("simulate", ROBOT, "--motion", kinds[kind], "--noise", "0", "-o", out)
    assert done.exit_code == 0, done.stderr
    stored = json.loads((out / "trajectory.json").read_text())
    assert stored["kind"] == ("sampled" if kind == "csv" else kind)
    motion = trajectory_from_dict(stored)
    q = positions(out / "log.csv")
    assert len(q) == round((motion.duration + 2.0) * 250) + 1
    wanted = motion.sample(np.arange(len(q)) / 250 - 1.0).q
    assert np.abs(q - wanted).max() < 0.05 < np.ptp(wanted, axis=0).min()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["csv", "chained"])
def test_periods_repeat_the_motion(
    kind: str, kinds: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    run = ("simulate", ROBOT, "--motion", kinds[kind], "--noise", "0")
    done = command(*run, "--periods", "3", "-o", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    once = 3.0 if kind == "chained" else 1.5
    assert f"periods     3 of {once:g} s" in done.stdout
    q = positions(tmp_path / "out" / "log.csv")
    rows = round(once * 250)
    assert len(q) == 3 * rows + 501
    np.testing.assert_allclose(q[250 + rows : 250 + 2 * rows], q[250 + 2 * rows : -251], atol=2e-3)
    assert np.ptp(q[250 + rows : 250 + 2 * rows], axis=0).min() > 0.05


@pytest.mark.slow
def test_a_motion_that_does_not_return_has_no_periods(
    given: Path, command: Command, tmp_path: Path
) -> None:
    robot = load_robot(given / "demo_arm.toml").robot
    away = np.zeros((2, robot.n))
    away[1, 2] = 0.25
    running = np.zeros((1, 3, robot.n))
    running[0, 1:, 1] = 0.1, -0.1
    motions = {
        "reach": (SampledMotion([0.0, 1.0], away), "position 0 rad and ends with 0.25 rad"),
        "run": (PiecewiseMotion([0.0, 1.0], running), "speed 0.1 rad/s and ends with -0.1 rad/s"),
    }
    for name, (motion, wrong) in motions.items():
        path = tmp_path / f"{name}.json"
        write_json(path, motion.to_dict())
        run = ("simulate", ROBOT, "--motion", path, "-o", tmp_path / f"{name} out")
        done = command(*run, "--periods", "2")
        assert done.exit_code == 2 and wrong in " ".join(done.stderr.split())
        assert "--periods" in done.stderr and not (tmp_path / f"{name} out").exists()
        assert command(*run).exit_code == 0


@pytest.mark.slow
def test_a_dry_run_goes_the_same_way_slowly(
    kinds: dict[str, Path], command: Command, tmp_path: Path
) -> None:
    run = ("simulate", ROBOT, "--motion", kinds["fourier"], "--noise", "0")
    done = command(*run, "--periods", "2", "--dry-run", "0.5", "-o", tmp_path / "slow")
    assert done.exit_code == 0, done.stderr
    assert "dry run     at 0.5 of the speed: 6 s, not 3 s" in done.stdout
    full = command(*run, "--periods", "2", "-o", tmp_path / "full")
    assert "dry run" not in full.stdout
    slow, fast = (positions(tmp_path / name / "log.csv") for name in ("slow", "full"))
    assert len(slow) == 8 * 250 + 1
    np.testing.assert_allclose(slow[250:-250:2], fast[250:-250], atol=0.05)
    stored = json.loads((tmp_path / "slow" / "trajectory.json").read_text())
    assert stored["kind"] == "slowed" and trajectory_from_dict(stored).duration == 6.0


def test_factors_of_dry_runs_are_below_one(command: Command, tmp_path: Path) -> None:
    for factor in ("0", "-1", "5", "nan"):
        done = command(*RUN, "--dry-run", factor, "-o", tmp_path / "o")
        assert done.exit_code == 2 and "--dry-run" in done.stderr and "0.2" in done.stderr
    assert command(*RUN, "--periods", "0", "-o", tmp_path / "o").exit_code == 2
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    ("options", "hours"),
    [
        (("--periods", "1000000000"), "4.167e+05 hours long: 1000000000 times 1.5 s"),
        (("--dry-run", "1e-9"), "4.167e+05 hours long: 1 times 1.5 s at 1e-09 of the speed"),
        (("--period", "86401"), "24 hours long"),
        (("--period", "inf"), "inf hours long"),
    ],
)
def test_runs_of_more_than_a_day_are_refused(
    options: tuple[str, str], hours: str, command: Command, tmp_path: Path
) -> None:
    done = command(*RUN, *options, "-o", tmp_path / "o")
    message = " ".join(done.stderr.split())
    assert done.exit_code == 2 and hours in message and "fewer periods" in message
    assert not (tmp_path / "o").exists()


def test_the_seed_is_stated_to_make_the_robot(command: Command, tmp_path: Path) -> None:
    shown = command(*RUN, "--seed", "4", "-o", tmp_path / "o").stdout
    assert "seed 4 (another seed is another robot)" in shown and "--motion" in shown
