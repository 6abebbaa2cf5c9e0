"""`steelyard contact`: what it finds, prints, writes and refuses."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import steelyard
from cli.conftest import Command
from cli.mistakes import leftovers
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.scores.residual_traces_and_band_calibration import residual_trace

PUSH = (1.5, 1.9)
"""When the demo arm is pushed [s]."""


def changed(log: Path, path: Path, change: dict[str, np.ndarray | float]) -> Path:
    """A log with something added to some columns."""
    header, *lines = log.read_text().splitlines()
    names = header.split(",")
    table = np.array([line.split(",") for line in lines], dtype=float)
    for name, add in change.items():
        table[:, names.index(name)] += add
    rows = [",".join(repr(float(x)) for x in row) for row in table]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def columns(log: Path) -> tuple[np.ndarray, list[str]]:
    """Time and the names of the efforts."""
    names = log.read_text().splitlines()[0].split(",")
    t = np.loadtxt(log, delimiter=",", skiprows=1)[:, 0]
    return t - t[0], [name for name in names if name.startswith(("effort", "tau", "current"))]


@pytest.fixture(scope="module")
def pushed(given: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The validation log with a push on the second of its links: joints 1 and 2 feel it."""
    log = given / "validation.csv"
    t, efforts = columns(log)
    push = 25.0 * ((t > PUSH[0]) & (t < PUSH[1]))
    path = tmp_path_factory.mktemp("pushed") / "pushed.csv"
    return changed(log, path, {efforts[0]: 0.8 * push, efforts[1]: push})


def test_a_push_is_found(pushed: Path, identified: Path, command: Command, tmp_path: Path) -> None:
    done = command("contact", identified, pushed, "--json", "-o", tmp_path / "out")
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout)
    assert printed == json.loads((tmp_path / "out" / "contact.json").read_text())
    (event,) = printed["events"]
    robot = steelyard.load_model(identified).model.robot
    assert 0.0 <= event["start_s"] - PUSH[0] < 0.1 and -0.02 < event["end_s"] - PUSH[1] < 0.2
    assert event["joint"] in robot.joint_names[:2]
    assert {load["joint"] for load in event["joints"]} == set(robot.joint_names[:2])
    sizes = {load["joint"]: load["peak"] for load in event["joints"]}
    assert sizes[robot.joint_names[1]] == pytest.approx(25.0, rel=0.15)
    assert printed["payload"] is None
    assert event["links"] == [body.name for body in robot.bodies[1:]] and event["link"] is None
    assert "left out when the model was identified" in printed["calibration"]["from"]
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "1 contact in" in page and f"{robot.bodies[1].name} or beyond" in page


def test_free_motion_has_no_contact(given: Path, identified: Path, command: Command) -> None:
    done = command("contact", identified, given / "validation.csv")
    assert done.exit_code == 0, done.output
    words = " ".join(done.stdout.split())
    assert "No contact in" in words and "min of free motion: " in words
    assert "1 false alarm per hour is more than this calibration supports" in words


def test_a_rate_that_the_calibration_does_not_support_is_refused(
    given: Path, identified: Path, command: Command
) -> None:
    done = command("contact", identified, given / "validation.csv", "--rate", "0.01")
    assert done.exit_code == 2 and done.stdout == ""
    assert "0.01 false alarms per hour cannot be claimed from" in done.stderr
    assert "calibrate with" in done.stderr


def test_calibration_logs_that_are_too_short_are_refused(
    given: Path, pushed: Path, identified: Path
) -> None:
    with pytest.raises(steelyard.SteelyardError, match="s of free motion are too short"):
        steelyard.contact(identified, given / "validation.csv", calibrate=f"{pushed}@0:1")


def test_fitted_logs_do_not_calibrate(given: Path, identified: Path, command: Command) -> None:
    log = given / "identification.csv"
    done = command("contact", identified, given / "validation.csv", "--calibrate", log)
    assert done.exit_code == 2
    assert "no calibration log is left: identification was fitted" in done.stderr


def test_efforts_without_gravity_are_refused(given: Path, identified: Path, tmp_path: Path) -> None:
    log, model = given / "validation.csv", steelyard.load_model(identified)
    (run,) = steelyard.load_runs(given / "demo_arm.toml", log)
    t, efforts = columns(log)
    motion = run.whole().motion
    gravity = model.gravity(motion.q) / model.signals.gains
    lacking = {
        name: -np.interp(t, motion.t, own) for name, own in zip(efforts, gravity.T, strict=True)
    }
    path = changed(log, tmp_path / "compensated.csv", lacking)
    uses = (steelyard.contact, steelyard.health, steelyard.identify_payload)
    for use in (*uses, steelyard.payload_events):
        with pytest.raises(steelyard.SteelyardError, match="lack .* % of the gravity"):
            use(model, path)


def at_rest(model: IdentifiedModel, speed: float, path: Path) -> Path:
    """A log of 60 s in which all joints creep, and efforts balance gravity alone."""
    t, signals = np.arange(0.0, 60.0, 0.004), model.signals
    dq = np.full((len(t), model.robot.n), speed)
    q = 0.3 + dq * t[:, None]
    effort = model.gravity(q) / signals.gains
    assert signals.time and signals.velocity
    names = [signals.time, *signals.position, *signals.velocity, *signals.effort]
    table = np.column_stack([t, q, dq, effort])
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="")
    return path


@pytest.mark.slow
def test_a_log_at_rest_lacks_no_friction(identified: Path, tmp_path: Path) -> None:
    data = json.loads((identified / "model.json").read_text().replace('"coulomb', '"dahl'))
    terms = data["model"]["terms"]
    terms[:] = [{"law": "dahl", "length": 1e-3} if t["law"] == "dahl" else t for t in terms]
    model = IdentifiedModel.from_dict(data)
    log = at_rest(model, 1e-4, tmp_path / "rest.csv")
    assert steelyard.contact(model, f"{log}@30:", calibrate=f"{log}@:30").events == ()


@pytest.mark.slow
def test_rests_calibrate_beside_motion(given: Path, identified: Path, tmp_path: Path) -> None:
    model = replace(steelyard.load_model(identified), calibration=None)
    rest, moving = at_rest(model, 0.0, tmp_path / "rest.csv"), given / "validation.csv"
    for logs in ([f"{rest}@:30"], [f"{rest}@:30", f"{moving}@0:2"]):
        found = steelyard.contact(model, f"{rest}@30:", calibrate=logs)
        assert np.isfinite(found.thresholds.edges).all()


def test_efforts_of_another_robot_are_refused(
    given: Path, identified: Path, tmp_path: Path
) -> None:
    log, model = given / "validation.csv", steelyard.load_model(identified)
    _, efforts = columns(log)
    names = log.read_text().splitlines()[0].split(",")
    table = np.loadtxt(log, delimiter=",", skiprows=1)
    own = table[:, [names.index(name) for name in efforts]].T
    other = {name: 20.0 * b - a for name, a, b in zip(efforts, own, own[::-1], strict=True)}
    path = changed(log, tmp_path / "other.csv", other)
    for use in (steelyard.contact, steelyard.health, steelyard.identify_payload):
        with pytest.raises(steelyard.SteelyardError, match="of the squared efforts of this log"):
            use(model, path)


def test_a_slow_log_is_refused(given: Path, identified: Path) -> None:
    (run,) = steelyard.load_runs(given / "demo_arm.toml", given / "validation.csv")
    with pytest.raises(steelyard.SteelyardError, match="250 Hz, less than 10 times"):
        residual_trace(steelyard.load_model(identified), run, 30.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--calibrate", "../given/nothing.csv"), "no such log"),
        (("--calibrate", "{log}"), "is both fitted and validated"),
        (("-o", "../given"), "exists already"),
    ],
)
def test_mistakes(
    arguments: tuple[str, str],
    words: str,
    pushed: Path,
    identified: Path,
    command: Command,
    work: Path,
) -> None:
    done = command("contact", identified, pushed, *(a.format(log=pushed) for a in arguments))
    assert done.exit_code == 2 and done.stdout == ""
    assert words in done.stderr
    assert leftovers(work) == []


def test_what_thresholds_cannot_show_is_not_called_free_of_contact(
    given: Path, identified: Path
) -> None:
    """Thresholds above all efforts of a joint, or positions that never change, decide nothing."""
    found = steelyard.contact(identified, given / "validation.csv")
    first, known = found.joints[0], found.thresholds
    limits = np.full_like(known.limits, 0.1)
    found = replace(found, thresholds=replace(known, limits=limits.copy()))
    assert found.headline.startswith("No contact in") and not found.blind
    limits[0] = 9054.0
    one = replace(found, thresholds=replace(found.thresholds, limits=limits))
    assert one.blind == (first,) and one.to_dict()["undecided"] == [first]
    assert one.headline.endswith(f", at {len(found.joints) - 1} of {len(found.joints)} joints")
    assert any(
        f"cannot decide where thresholds are above all efforts: {first} (9" in w
        for w in one.warnings
    )
    every = replace(one, thresholds=replace(one.thresholds, limits=np.full_like(limits, 9054.0)))
    assert every.headline.startswith("Cannot decide on contact in")
    still = replace(found.trace, fastest=0.0 * found.trace.fastest)
    frozen = replace(found, trace=still)
    assert frozen.headline.startswith("Cannot decide on contact in")
    assert any("positions never change" in words for words in frozen.warnings)
