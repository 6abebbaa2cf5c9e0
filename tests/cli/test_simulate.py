"""`steelyard simulate`: payloads, and the causes of torque of the robot file."""

import json
from pathlib import Path

import numpy as np
import polars as pl

from cli.conftest import Command
from cli.mistakes import ROBOT

RUN = ("simulate", ROBOT, "--period", "1.5", "--noise", "0")


def efforts(folder: Path) -> np.ndarray:
    table = pl.read_parquet(folder / "log.parquet")
    return table.select([name for name in table.columns if name.startswith("tau")]).to_numpy()


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
    # a load at the elbow is not felt by the joints beyond it
    apart = np.abs(elsewhere - bare)[250:600].max(axis=0)
    assert apart[:2].max() > 2.0 and apart[3:].max() < 0.02 * apart[:2].max()


def test_payloads_that_cannot_be_are_refused(command: Command, tmp_path: Path) -> None:
    out = ("-o", tmp_path / "o")
    done = command(*RUN, "--payload-mass", "3", "--payload-frame", "tol", *out)
    assert done.exit_code == 2
    assert "'tol', which is no moving frame" in done.stderr and "tool" in done.stderr
    done = command(*RUN, "--payload-mass", "3", "--attach", "2", "--release", "1", *out)
    assert done.exit_code == 2 and "taken at 2 s and let go at 1 s" in done.stderr
    done = command(*RUN, "--payload-mass", "3", "--attach", "300", *out)
    assert done.exit_code == 2 and "taken at 300 s, but the log ends at" in done.stderr
    assert command(*RUN, "--payload-mass", "0", *out).exit_code == 2
    assert not (tmp_path / "o").exists()


def test_an_option_of_a_payload_needs_its_mass(command: Command, tmp_path: Path) -> None:
    for option in (("--attach", "1"), ("--release", "2"), ("--payload-frame", "tool")):
        done = command(*RUN, *option, "-o", tmp_path / "o")
        assert done.exit_code == 2 and "--payload-mass" in done.stderr


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
