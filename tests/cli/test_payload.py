"""`steelyard payload`: what it prints, writes and refuses."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from cli.conftest import Command
from cli.mistakes import leftovers
from steelyard.base.arrays import Parameters
from steelyard.base.errors import DataError
from steelyard.base.motion import run
from steelyard.estimate.identified_model import load_model
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.simulate.drives_sensors_and_loads import Payload
from steelyard.simulate.ground_truth import random_truth
from steelyard.simulate.virtual_robot import VirtualRobot, customary_sensors
from steelyard.uses.payload.payload import identify_payload, payload_events

LOAD = Inertia.about_com(1.5, (0.02, 0.05, 0.08), 0.004 * np.eye(3))
"""About the origin of the demo arm's last link."""


@pytest.fixture(scope="module")
def given(six_given: Path) -> Path:
    return six_given


@pytest.fixture(scope="module")
def identified(six_identified: Path) -> Path:
    return six_identified


@pytest.fixture(scope="module")
def loaded(given: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo arm's log with a load on its last link."""
    robot = load_robot(given / "demo_arm.toml").robot
    truth = random_truth(robot, 0)
    carried = Payload(LOAD, robot.bodies[-1].name)
    sensors = customary_sensors(robot, truth)
    rig = VirtualRobot(robot, truth, sensors, seed=3, payload=carried)
    path = tmp_path_factory.mktemp("loaded") / "loaded.parquet"
    run(rig, random_fourier(robot, seed=11, period=3.0), path)
    return path


@pytest.mark.parametrize("together", [False, True])
def test_the_load_is_weighed(
    together: bool, loaded: Path, given: Path, identified: Path, command: Command, tmp_path: Path
) -> None:
    options = ["--unloaded", given / "identification.csv"] if together else []
    done = command("payload", identified, loaded, *options, "--json", "-o", tmp_path / "out")
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout)
    assert printed == json.loads((tmp_path / "out" / "payload.json").read_text())
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["payload.json"]
    assert abs(printed["mass"] - LOAD.mass) < 1.5 * printed["mass_half_width"] < 0.1
    error = np.abs(np.array(printed["centre"]) - LOAD.com)
    assert np.all(error < 1.5 * np.array(printed["centre_half_width"]))
    words = "from the unloaded and loaded runs" if together else "are the model's"
    assert words in " ".join(printed["notes"])


def test_the_table_names_frame_numbers_and_units(
    loaded: Path, identified: Path, command: Command
) -> None:
    done = command("payload", identified, loaded)
    assert done.exit_code == 0, done.output
    assert re.match(r"Payload: 1\.[45]\d* ± 0\.0\d+ kg \(95 % interval\)\n", done.stdout)
    last = load_robot_of(identified)
    words = " ".join(done.stdout.split())
    assert f"payload in frame '{last}'" in words
    for piece in ("mass", "kg", "centre x", "Iyz about the centre", "kg m²", "± 95 %"):
        assert piece in words
    assert "the inertia is" in words
    assert "note: friction and offsets are estimated per run, within 50 % of the model's" in words
    assert "drive gains" not in words


def load_robot_of(identified: Path) -> str:
    """The last link of an identified model."""
    printed = json.loads((identified / "model.json").read_text())
    return str(printed["model"]["robot"]["bodies"][-1]["name"])


def test_a_log_that_the_model_knows_is_reported(
    given: Path, identified: Path, command: Command
) -> None:
    done = command("payload", identified, given / "identification.csv")
    assert done.exit_code == 0, done.output
    words = " ".join(done.stdout.split())
    assert "the interval of the mass contains zero: no payload is detected" in words
    assert "centre" not in words and words.startswith("No payload detected: ")
    assert "the model was identified from identification.csv" in words


@pytest.mark.slow
@pytest.mark.parametrize("when", [(), ("--when",)])
def test_a_log_that_no_payload_explains_is_named(
    when: tuple[str, ...], picking: Path, identified: Path, command: Command, tmp_path: Path
) -> None:
    table = pl.read_parquet(picking)
    wrong = pl.col("tau2_Nm") + 6.0 * (9.0 * pl.col("time_s")).sin()
    table.with_columns(tau2_Nm=wrong).write_parquet(tmp_path / "odd.parquet")
    done = command("payload", identified, tmp_path / "odd.parquet", *when, "-o", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert "! the model with any payload does not explain this log: at " in done.stdout
    assert "positions, efforts or units differ" in " ".join(done.stdout.split())
    found = json.loads((tmp_path / "out" / "payload.json").read_text())
    result = found["logs"][0] if when else found
    assert "times that of the model's own logs" in result["unexplained"]
    if when:
        assert "Limits of this result" in (tmp_path / "out" / "report.html").read_text()
        right = json.loads(command("payload", identified, picking, "--when", "--json").stdout)
        assert right["logs"][0]["unexplained"] is None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--frame", "falnge"), "there is no frame 'falnge'"),
        (("--unloaded", "../given/nothing.csv"), "no such log"),
        (("--unloaded", "{log}"), "is fitted twice"),
        (("-o", "../given"), "exists already"),
        (("--mass", "9"), "the data contradict the known mass of 9 kg"),
        (("--com", "0", "0", "0.5"), "the data contradict the known centre of mass"),
        (("--box", "0.1", "0.1", "0"), "the dimensions of the box are 0.1, 0.1, 0"),
        (("--sphere", "0.1", "--cylinder", "0.1", "0.2"), "give one of box, cylinder and sphere"),
    ],
)
def test_mistakes(
    arguments: tuple[str, str],
    words: str,
    loaded: Path,
    identified: Path,
    command: Command,
    work: Path,
) -> None:
    done = command("payload", identified, loaded, *(a.format(log=loaded) for a in arguments))
    assert done.exit_code == 2 and done.stdout == ""
    assert words in done.stderr
    assert [line.split()[0] for line in done.stderr.splitlines()] == ["error:", "where", "fix"]
    assert leftovers(work) == []


def test_a_misspelt_frame_gets_the_nearest(
    loaded: Path, identified: Path, command: Command
) -> None:
    name = load_robot_of(identified)
    assert (
        f"did you mean '{name}'"
        in command("payload", identified, loaded, "--frame", name[:-1]).stderr
    )


def test_help_shows_an_example(command: Command) -> None:
    assert "Example: steelyard payload" in command("payload", "--help").stdout


@pytest.mark.slow
def test_what_is_known_of_the_load_counts(loaded: Path, identified: Path, command: Command) -> None:
    options = ["--mass", LOAD.mass, "--com", *LOAD.com, "--sphere", 0.2309]
    free, known = (
        json.loads(command("payload", identified, loaded, *some, "--json").stdout)
        for some in ([], options)
    )
    assert known["consistent_body"] is True and free["consistent_body"] is True
    assert known["mass_half_width"] < 0.005 and known["mass"] == pytest.approx(1.5, rel=3e-3)
    assert np.abs(np.array(known["centre"]) - LOAD.com).max() < 2e-3
    widths = [np.diag(some["inertia_com_half_width"]) for some in (free, known)]
    assert np.all(widths[1] <= widths[0] + 1e-12)
    assert "known: mass 1.5 kg (± 0.1 %)" in known["notes"]
    assert any("sphere of 0.2309 m diameter" in note for note in known["notes"])


def test_the_uncertainty_of_gains_counts_for_torques_too(
    loaded: Path, identified: Path, command: Command
) -> None:
    exact, unsure = (
        json.loads(
            command("payload", identified, loaded, "--gain-uncertainty", gain, "--json").stdout
        )
        for gain in (0.0, 0.05)
    )
    assert unsure["mass_half_width"] > 2.0 * exact["mass_half_width"]


def test_gravity_compensated_efforts_are_refused(identified: Path, loaded: Path) -> None:
    model = load_model(identified)
    kind = replace(model.signals, effort_kind="gravity_compensated_torque")
    with pytest.raises(DataError, match="gravity-compensated"):
        identify_payload(replace(model, signals=kind), loaded)


def test_numbers_of_what_is_known_are_counted(identified: Path, loaded: Path) -> None:
    for words, options in (
        ("'box' has 2 numbers", {"box": [0.1, 0.2]}),
        ("'com' has 4 numbers", {"com": [0.0, 0.1, 0.2, 0.3]}),
        ("'cylinder' has 1 numbers", {"cylinder": [0.1]}),
    ):
        with pytest.raises(DataError, match=words):
            identify_payload(identified, loaded, **options)  # type: ignore[arg-type]


PICK, RELEASE = 6.0, 17.0


@pytest.fixture(scope="module")
def picking(given: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo arm's log in which it carries the load for a while."""
    robot = load_robot(given / "demo_arm.toml").robot
    truth = random_truth(robot, 0)
    carried = Payload(LOAD, robot.bodies[-1].name, PICK, RELEASE)
    rig = VirtualRobot(robot, truth, customary_sensors(robot, truth), seed=4, payload=carried)
    path = tmp_path_factory.mktemp("picking") / "picking.parquet"
    run(rig, random_fourier(robot, seed=12, period=24.0, harmonics=10), path)
    return path


@pytest.mark.slow
def test_when_a_load_is_picked_up_and_put_down(
    picking: Path, identified: Path, command: Command, tmp_path: Path
) -> None:
    done = command("payload", identified, picking, "--when", "--json", "-o", tmp_path / "out")
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout)
    assert printed == json.loads((tmp_path / "out" / "payload.json").read_text())
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "picking: 2 changes of the payload" in page and "Mass of the payload along" in page
    kinds = [event["kind"] for event in printed["events"]]
    assert kinds == ["picked up", "put down"]
    for event, when in zip(printed["events"], (PICK, RELEASE), strict=True):
        assert event["run"] == "picking"
        assert abs(event["time"] - when) < 0.3
        assert event["earliest"] - 0.1 <= when <= event["latest"] + 0.1
        assert abs(event["mass"] - LOAD.mass) < 1.5 * event["mass_half_width"] < 0.3
    (carried,) = printed["logs"][0]["carried"]
    assert carried["payload"]["consistent_body"] is True
    words = " ".join(command("payload", identified, picking, "--when").stdout.split())
    assert (
        "picking: 2 changes of the payload" in words
        and "picked up" in words
        and "carried from" in words
    )
    assert "false events per hour" in words


@pytest.mark.slow
def test_what_is_carried_all_along_is_no_event(
    picking: Path, identified: Path, command: Command
) -> None:
    """Of the log in which it is picked up, the time in which it is carried."""
    span = f"{picking}@{PICK + 0.3}:{RELEASE - 0.3}"
    done = command("payload", identified, span, "--when", "--json")
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout)
    assert printed["events"] == []
    (carried,) = printed["logs"][0]["carried"]
    assert abs(carried["payload"]["mass"] - LOAD.mass) < 0.15
    words = command("payload", identified, span, "--when").stdout
    assert "no change of payload" in words and "carried from" in words


@pytest.mark.slow
def test_a_load_that_the_model_lacks_is_reported(
    picking: Path, given: Path, identified: Path, command: Command
) -> None:
    """Where the model is used for something else, or contact is calibrated."""
    span, words = f"{picking}@{PICK + 0.3}:{RELEASE - 0.3}", []
    for arguments in (
        ("contact", identified, span),
        ("health", identified, span),
        ("contact", identified, given / "validation.csv", "--calibrate", span),
    ):
        done = command(*arguments)
        words.append(" ".join(done.output.split()))
    for one in words:
        assert "are those with a payload of 1.49 ±" in one and "the model does not have" in one
    assert "likelier than contact" in words[0]
    assert "no calibration log is left: left out of the calibration: the efforts" in words[2]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--unloaded", "../given/validation.csv"), "events are found with the model alone"),
        (("--mass", "1.5"), "events are found with the model alone"),
        (("--frame", "falnge"), "there is no frame 'falnge'"),
    ],
)
def test_mistakes_with_when(
    arguments: tuple[str, str], words: str, picking: Path, identified: Path, command: Command
) -> None:
    done = command("payload", identified, picking, "--when", *arguments)
    assert done.exit_code == 2 and words in done.stderr


def test_a_log_too_short_for_changes_is_refused(
    picking: Path, identified: Path, command: Command
) -> None:
    done = command("payload", identified, f"{picking}@5:9", "--when")
    assert done.exit_code == 2
    assert "too short to find when a payload changes" in done.stderr


@pytest.mark.slow
def test_a_model_that_knows_nothing_of_the_bodies_weighs_nothing(
    picking: Path, identified: Path
) -> None:
    """As one of a log in which the arm did not move enough to identify its links."""
    model = load_model(identified)
    estimate = model.estimate
    names = estimate.parameters.names
    laws = ("coulomb", "viscous", "offset")
    kept = [k for k, name in enumerate(names) if name.split(".")[0] in laws]
    poor = replace(
        estimate,
        parameters=Parameters(
            tuple(names[k] for k in kept),
            tuple(estimate.parameters.units[k] for k in kept),
            estimate.parameters.values[kept],
        ),
        covariance=estimate.covariance[np.ix_(kept, kept)],
    )
    for weigh in (identify_payload, payload_events):
        with pytest.raises(DataError, match="identifiable"):
            weigh(replace(model, estimate=poor), picking)
