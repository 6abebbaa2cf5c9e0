"""`steelyard health`: what it prints, writes and refuses."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import steelyard
from cli.conftest import Command
from cli.mistakes import leftovers
from short_arm import without_wrist
from steelyard.base.motion import Motion
from steelyard.estimate.scores.parts_and_bands_along_run import only
from steelyard.simulate.ground_truth import random_truth
from steelyard.uses.health.drift_detection import QUANTITIES

WORN = 0.6
"""Growth of the elbow's Coulomb friction."""


RESCALED, SHIFTED = 0.08, 1.5
"""Change of the second drive gain, and of the third sensor's offset [Nm]."""

LOGS = (("fit", 0.0), ("before", 0.0), ("after", WORN), ("repaired", 0.0))
"""Names, and how much the elbow is worn."""


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with logs of the demo arm before and after wear or repair, and its model."""
    folder = tmp_path_factory.mktemp("worn")
    loaded = without_wrist(folder)
    truth = random_truth(loaded.robot, 0)
    valued = truth.model.at(truth.values)
    dry = only(valued, lambda term: term.law == "coulomb")
    for number, (name, worn) in enumerate(LOGS):
        rng = np.random.default_rng(number)
        t = np.arange(0.0, 80.0, 0.02)
        w = 2.0 * np.pi * np.array([0.07, 0.16, 0.31])[:, None]
        phase = rng.uniform(0.0, 6.28, (loaded.robot.n, 3, 1))
        angle = w * t + phase
        derivatives = (np.sin(angle), w * np.cos(angle), -w * w * np.sin(angle))
        q, dq, ddq = (np.sum(0.25 * x, axis=1).T for x in derivatives)
        motion = Motion(t, q, dq, ddq)
        effort = valued.torque(motion)
        effort[:, 2] += worn * dry.torque(motion)[:, 2]
        if name == "repaired":
            effort[:, 1] *= 1.0 + RESCALED
            effort[:, 2] += SHIFTED
        effort += 0.02 * effort.std(axis=0) * rng.standard_normal(effort.shape)
        columns = {"time_s": t}
        for label, signal in (("q{}_rad", q), ("dq{}_rad_s", dq), ("tau{}_Nm", effort)):
            noise = 1e-5 * rng.standard_normal(signal.shape)
            columns |= {label.format(k + 1): x for k, x in enumerate((signal + noise).T)}
        np.savez(folder / f"{name}.npz", **columns)
    found = steelyard.identify(folder / "demo_arm.toml", folder / "fit.npz", check=False)
    found.save(folder / "model")
    return folder


@pytest.mark.slow
def test_wear_is_named_and_nothing_else(arm: Path, command: Command, tmp_path: Path) -> None:
    logs = [arm / "before.npz", arm / "after.npz"]
    done = command("health", arm / "model", *logs, "--json", "-o", tmp_path / "out")
    assert done.exit_code == 1, done.output
    printed = json.loads(done.stdout)
    assert printed == json.loads((tmp_path / "out" / "health.json").read_text())
    joints = steelyard.load_model(arm / "model").joints
    named = {(drift["joint"], drift["quantity"]) for drift in printed["drifts"]}
    assert named == {(joints[2], "dry friction")}
    (step,) = [drift for drift in printed["drifts"] if drift["shape"] == "steps"]
    assert step["size"] == pytest.approx(WORN, abs=0.06) and step["logs"] == ["before", "after"]
    assert len(printed["windows"]) == len(joints) * len(QUANTITIES)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "1 of 3 joints drifted in 2 logs" in page and "between before and after" in page


@pytest.mark.slow
def test_a_log_beside_its_copy_has_not_drifted(arm: Path, command: Command, tmp_path: Path) -> None:
    copy = shutil.copy(arm / "before.npz", tmp_path / "copy.npz")
    done = command("health", arm / "model", arm / "before.npz", copy, "--json")
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout, parse_constant=pytest.fail)
    assert printed["drifts"] == []


@pytest.mark.slow
def test_gains_and_offsets_are_named(arm: Path) -> None:
    found = steelyard.health(arm / "model", [arm / "before.npz", arm / "repaired.npz"])
    joints = steelyard.load_model(arm / "model").joints
    steps = {(c.joint, c.quantity): c for c in found.drifts if c.shape == "steps"}
    assert set(steps) == {(joints[1], "effort scale"), (joints[2], "offset")}
    scale, offset = steps[joints[1], "effort scale"], steps[joints[2], "offset"]
    assert scale.size == pytest.approx(RESCALED, abs=2.0 * scale.half_width) and not scale.unit
    assert offset.size == pytest.approx(SHIFTED, abs=2.0 * offset.half_width)
    assert offset.unit == "Nm"


def test_one_line_per_joint(arm: Path, command: Command) -> None:
    done = command("health", arm / "model", arm / "before.npz")
    assert done.exit_code == 0, done.output
    words = " ".join(done.stdout.split())
    assert "No drift in before" in words and "changes tested" in words
    for quantity in QUANTITIES:
        assert quantity.split()[0] in words


def test_joints_of_which_nothing_is_decided_are_named(arm: Path) -> None:
    found = steelyard.health(arm / "model", arm / "before.npz")
    assert found.blind == () and found.headline == "No drift in before"
    joint = found.joints[1]
    wide = [replace(c, half_width=12.0) if c.joint == joint else c for c in found.changes]
    headline = replace(found, changes=tuple(wide)).headline
    assert headline == f"No drift in before, which cannot decide for {joint}"


def with_efforts(arm: Path, factors: list[float]) -> Path:
    """The first log with other efforts."""
    columns = dict(np.load(arm / "before.npz"))
    for k, factor in enumerate(factors):
        columns[f"tau{k + 1}_Nm"] = factor * columns[f"tau{k + 1}_Nm"]
    path = arm / f"efforts_{'_'.join(f'{x:g}' for x in factors)}.npz"
    np.savez(path, **columns)
    return path


def test_a_short_log_with_other_efforts_does_not_pass(
    arm: Path, command: Command, tmp_path: Path
) -> None:
    log = with_efforts(arm, [1.0, 1.0, 1.5])
    done = command("health", arm / "model", f"{log}@0:15", "-o", tmp_path / "out")
    joint = steelyard.load_model(arm / "model").joints[2]
    words = " ".join(done.stdout.split())
    assert done.exit_code == 1, done.output
    assert "1 of 3 joints differ in efforts_1_1_1.5@:15, drift not proven" in words
    assert "one log cannot tell drift from an error of the model" in words
    assert f"{joint} (" in words and "effort scale" in words and "No drift" not in words
    saved = json.loads((tmp_path / "out" / "health.json").read_text())
    assert saved["drifts"] == [] and {one["joint"] for one in saved["unproven"]} == {joint}
    assert saved["warnings"][0].startswith("one log cannot tell")


def test_a_reversed_joint_is_refused(arm: Path, command: Command) -> None:
    log = with_efforts(arm, [1.0, -1.0, 1.0])
    done = command("health", arm / "model", log)
    joint = steelyard.load_model(arm / "model").joints[1]
    assert done.exit_code == 2 and done.stdout == ""
    assert f"the effort of {joint} has the reversed sign" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("../given/nothing.csv",), "no such log"),
        (("{log}",), "is fitted twice"),
        (("-o", "../given"), "exists already"),
        (("{log}@0:0.8",), "error:"),
    ],
)
def test_mistakes(
    arguments: tuple[str, ...], words: str, arm: Path, command: Command, work: Path
) -> None:
    log = arm / "before.npz"
    first = [] if "@" in arguments[0] else [log]
    done = command("health", arm / "model", *first, *(a.format(log=log) for a in arguments))
    assert done.exit_code == 2 and done.stdout == ""
    assert words in done.stderr
    assert leftovers(work) == []
