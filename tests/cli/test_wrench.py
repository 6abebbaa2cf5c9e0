"""`steelyard wrench`: what it finds, prints, writes and refuses."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import steelyard
from cli.conftest import Command
from cli.mistakes import leftovers
from cli.test_contact import changed, columns
from steelyard.base.arrays import Array
from steelyard.simulate.drives_sensors_and_loads import read_wrench
from steelyard.uses.wrench import wrench_along_run as efforts

AROUND = 1.5
"""Middle of the push [s]."""


def push(t: Array) -> Array:
    """A push in the base's axes, shape `(N, 6)`."""
    size = np.exp(-np.square((t - AROUND) / 0.4))
    return size[:, None] * np.array([12.0, -20.0, 15.0, 1.0, 0.0, -1.5])


@pytest.fixture(scope="module")
def given(six_given: Path) -> Path:
    return six_given


@pytest.fixture(scope="module")
def identified(six_identified: Path) -> Path:
    return six_identified


@pytest.fixture(scope="module")
def pushed(given: Path, identified: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The validation log with a push on the tool."""
    return with_wrench(given, identified, tmp_path_factory.mktemp("pushed") / "pushed.csv")


def with_wrench(given: Path, identified: Path, path: Path) -> Path:
    log, model = given / "validation.csv", steelyard.load_model(identified)
    (run,) = steelyard.load_runs(given / "demo_arm.toml", log)
    t, names = columns(log)
    motion = run.whole().motion
    q = np.column_stack([np.interp(t, motion.t, own) for own in motion.q.T])
    external = np.einsum("tij,ti->tj", model.jacobian(q, frame_of(model)), push(t))
    return changed(log, path, dict(zip(names, -(external / model.signals.gains).T, strict=True)))


def frame_of(model: steelyard.IdentifiedModel) -> str:
    """The last link."""
    return model.robot.bodies[-1].name


def test_a_push_is_found_within_its_interval(pushed: Path, identified: Path) -> None:
    model = steelyard.load_model(identified)
    found = steelyard.external_wrench(model, pushed, frame_of(model), axes="base")
    error = found.wrench - push(found.t)
    assert np.mean(np.abs(error) <= found.half_width) > 0.85
    at = int(np.argmin(np.abs(found.t - AROUND)))
    assert np.linalg.norm(error[at, :3]) < 5.0
    assert np.linalg.norm(found.wrench[at, :3]) == pytest.approx(27.7, abs=5.0)
    far = np.abs(found.t - AROUND) > 1.2
    assert np.sqrt(np.mean(np.square(error[far, :3]))) < 3.0


@pytest.mark.slow
def test_the_command_prints_and_writes_the_same(
    pushed: Path, identified: Path, command: Command, tmp_path: Path
) -> None:
    frame = frame_of(steelyard.load_model(identified))
    out = tmp_path / "out"
    done = command("wrench", identified, pushed, "--frame", frame, "--json", "-o", out)
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout)
    assert printed == json.loads((out / "wrench.json").read_text())
    assert printed["frame"] == frame and printed["method"] == "smoothed"
    found = steelyard.external_wrench(identified, pushed, frame)
    assert [one["name"] for one in printed["unobservable"]] == list(found.unobservable)
    assert len(printed["components"]) == 6
    table = pl.read_csv(out / "wrench.csv")
    assert len(table) == printed["samples"]
    largest = printed["components"][1]
    row = table.row(int(np.argmax(np.abs(table["fy_N"].to_numpy()))), named=True)
    assert largest["peak"] == row["fy_N"] and largest["peak_time_s"] == row["time_s"]
    assert largest["peak_half_width"] == row["half_width_fy_N"]
    again = read_wrench(out / "wrench.csv", frame, "frame")
    assert np.array_equal(again.t, table["time_s"].to_numpy())
    page = (out / "report.html").read_text(encoding="utf-8")
    assert f"Largest force on {frame}" in page and "Moment about z" in page
    shown = command("wrench", identified, pushed, "--frame", frame)
    words = " ".join(shown.stdout.split())
    assert (
        f"Largest force on {frame}: " in words
        and "force y [N]" in words
        and "smoothed, by the momentum" in words
    )
    assert len(shown.stdout.splitlines()) <= 25
    taken = command("wrench", identified, pushed, "--frame", frame, "-o", out)
    assert taken.exit_code == 2 and "exists already" in taken.stderr


@pytest.mark.slow
def test_torque_and_momentum_leave_the_same_over(pushed: Path, identified: Path) -> None:
    model = steelyard.load_model(identified)
    one, other = (
        steelyard.external_wrench(model, pushed, residual=kind).estimate.torque
        for kind in ("momentum", "torque")
    )
    middle = slice(10, -10)
    apart = np.sqrt(np.mean(np.square(one - other)[middle], axis=0))
    assert (apart < 0.1 * np.sqrt(np.mean(np.square(other[middle]), axis=0))).all()
    assert not np.array_equal(one, other)


@pytest.mark.slow
def test_options_are_used(pushed: Path, identified: Path) -> None:
    model = steelyard.load_model(identified)
    found = {
        name: steelyard.external_wrench(model, pushed, frame_of(model), **given)
        for name, given in {
            "usual": {},
            "weighted": {"method": "weighted"},
            "inverse": {"method": "inverse"},
            "at the origin": {"lever": 0.0},
            "small": {"force": 1.0, "method": "weighted"},
            "long": {"duration": 3.0},
            "slow": {"bandwidth": 2.0},
            "base": {"axes": "base"},
        }.items()
    }
    usual = found["usual"]
    assert np.array_equal(found["at the origin"].wrench[:, 3:], 0.0 * usual.wrench[:, 3:])
    assert np.abs(found["small"].wrench).max() < np.abs(found["weighted"].wrench).max()
    others = [found[name].wrench for name in ("weighted", "inverse", "long", "base")]
    assert all(not np.allclose(usual.wrench, one, atol=0.01) for one in others)
    assert found["slow"].estimate.bandwidth == 2.0
    assert np.diff(found["slow"].t) == pytest.approx(0.25, rel=0.02)
    assert np.diff(usual.t).max() < 0.1
    length = [np.linalg.norm(found[name].wrench[:, :3], axis=1) for name in ("usual", "base")]
    assert np.allclose(*length, atol=2.5)


@pytest.mark.slow
def test_a_frame_near_the_base_is_observable_in_part(
    pushed: Path, identified: Path, command: Command
) -> None:
    model = steelyard.load_model(identified)
    second = model.robot.bodies[1].name
    found = steelyard.external_wrench(model, pushed, second)
    assert len(found.unobservable) == 4 and np.isfinite(found.wrench).all()
    done = command("wrench", identified, pushed, "--frame", second)
    words = " ".join(done.stdout.split())
    assert (
        "not observable from the joint torques of this log: " in words
        and found.unobservable[0] in words
    )
    assert "an interval of 1.4 to 2 times the expected size on either side" in words
    assert "along unobservable directions by the expected size)" in words.split(" at ")[0]
    at = found.estimate.largest
    assert found.estimate.force_upper[at] > 2.5 * found.estimate.expected.force


@pytest.mark.slow
def test_a_long_log_is_estimated_stretch_by_stretch(
    pushed: Path, identified: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, events = steelyard.load_model(identified), []
    whole = steelyard.external_wrench(model, pushed)
    monkeypatch.setattr(efforts, "LONGEST_STRETCH", 2.0)
    parts = steelyard.external_wrench(model, pushed, progress=lambda e: events.append(e) or True)
    assert np.array_equal(whole.t, parts.t)
    assert np.array_equal(whole.estimate.torque, parts.estimate.torque)
    assert not np.array_equal(whole.wrench, parts.wrench)
    assert sum(event.phase == "estimating the wrench" for event in events) > 1


@pytest.mark.slow
def test_logs_that_cannot_be_used_are_refused(
    given: Path, identified: Path, pushed: Path, tmp_path: Path
) -> None:
    log, model = given / "validation.csv", steelyard.load_model(identified)
    (run,) = steelyard.load_runs(given / "demo_arm.toml", log)
    t, names = columns(log)
    motion = run.whole().motion
    for name, part in (
        ("gravity", model.gravity(motion.q)),
        ("friction", model.friction(motion)),
    ):
        lacking = {
            column: -np.interp(t, motion.t, own, left=0.0, right=0.0)
            for column, own in zip(names, (part / model.signals.gains).T, strict=True)
        }
        path = changed(log, tmp_path / f"{name}.csv", lacking)
        with pytest.raises(steelyard.SteelyardError, match=f"lack .* % of the {name}"):
            steelyard.external_wrench(model, path)
    header, *lines = log.read_text().splitlines()
    table = np.loadtxt(lines, delimiter=",")
    own = [header.split(",").index(name) for name in names]
    for name, gains, words in (
        ("milliamperes", 1000.0, "% of the squared efforts of this log, less than 25 %"),
        ("opposite", -1.0, "the effort.* ha.* the reversed sign"),
        (
            "opposite1",
            [1.0, -1.0, *[1.0] * (len(own) - 2)],
            "the effort of .* has the reversed sign",
        ),
    ):
        added = dict(zip(names, (table[:, own] * (np.asarray(gains) - 1.0)).T, strict=True))
        path = changed(log, tmp_path / f"{name}.csv", added)
        with pytest.raises(steelyard.SteelyardError, match=words):
            steelyard.external_wrench(model, path)
    with pytest.raises(steelyard.SteelyardError, match="too few for a bandwidth of 30 Hz"):
        steelyard.external_wrench(model, pushed, bandwidth=30.0)


@pytest.mark.slow
def test_rows_that_are_left_out_are_stated(given: Path, identified: Path, tmp_path: Path) -> None:
    log = given / "validation.csv"
    t, names = columns(log)
    missing = np.where((t > 1.0) & (t < 1.5), np.nan, 0.0)
    path = changed(log, tmp_path / "missing.csv", {names[0]: missing})
    count = int(np.isnan(missing).sum())
    words = f"missing: dropped {count} of {len(t)} rows: {count} with a cell that is missing"
    for use in (steelyard.external_wrench, steelyard.contact):
        stated = use(identified, path).warnings
        assert any(
            one.startswith(words) and "not examined: 1.00 to 1.50 s" in one for one in stated
        )
        assert not any("dropped" in one for one in use(identified, log).warnings)


def test_free_motion_has_no_force(given: Path, identified: Path) -> None:
    found = steelyard.external_wrench(identified, given / "validation.csv")
    assert found.headline.startswith("No force on ")
    assert found.to_dict()["largest_force"]["differs_from_zero"] is False


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--frame", "base"), "is fixed to the base: no joint moves it or feels what pushes there"),
        (("--frame", "nose"), "no frame 'nose'"),
        (("--bandwidth", "50"), "too few for a bandwidth of 50 Hz"),
        (("-o", "../given"), "exists already"),
        (("--method", "guess"), "guess"),
        (("--force", "inf"), "no expected size"),
        (("--force", "nan"), "no expected size: 0.1 to 100000 N can be expected"),
        (("--lever", "1e12"), "no expected size: 0 to 100 m can be expected"),
        (("--duration", "nan"), "no duration of a push"),
        (("--bandwidth", "0.001"), "too short for a bandwidth of 0.001 Hz (--bandwidth)"),
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
    done = command("wrench", identified, pushed, *arguments)
    assert done.exit_code == 2 and done.stdout == ""
    assert words in done.stderr
    assert leftovers(work) == []
