"""`steelyard wrench --measured`: the estimate beside a force/torque sensor of the log."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import steelyard
from cli.conftest import Command
from cli.test_contact import changed
from cli.test_contact import columns as columns_of
from steelyard.base.arrays import Array
from steelyard.robot.inertia_and_placement import rpy_rotation

FRAME, FLANGE = "tool", "flange"
AXES = ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")
NAMES = tuple(f"ft_{k}" for k in range(6))
PLACE, ANGLES = np.array([0.01, -0.02, 0.05]), (0.3, -0.4, 1.1)
AT = " ".join(f"{x:g}" for x in (*PLACE, *ANGLES))
BIAS = np.array([3.0, -5.0, 12.0, 0.2, -0.4, 0.1])
MASS, CENTRE = 1.2, np.array([0.02, -0.01, 0.06])
"""Of what the sensor carries [kg], about its origin along its axes [m]."""
STEP = 0.004
RESTS = ("0:0.9", "2.1:2.9", "4.1:4.9", "6.1:6.9")


@pytest.fixture(scope="module")
def model(six_identified: Path) -> steelyard.IdentifiedModel:
    return steelyard.load_model(six_identified)


def sensor(model: steelyard.IdentifiedModel, q: Array) -> tuple[Array, Array]:
    """Origin `(N, 3)` and axes `(N, 3, 3)` of the turned sensor."""
    position, axes = model.pose(q, FLANGE)
    return position + axes @ PLACE, axes @ rpy_rotation(*ANGLES)


def read_by_sensor(model: steelyard.IdentifiedModel, q: Array, wrench: Array) -> Array:
    """Wrenches `(N, 6)` about `FRAME`, axes of the base, as the sensor has them."""
    position, axes = sensor(model, q)
    lever = model.pose(q, FRAME)[0] - position
    moment = wrench[:, 3:] + np.cross(lever, wrench[:, :3])
    return np.hstack([np.einsum("tij,ti->tj", axes, x) for x in (wrench[:, :3], moment)])


def written(path: Path, log: Path, columns: dict[str, Array]) -> Path:
    """A log with more columns."""
    table = pl.read_csv(log)
    table.with_columns(**{name: pl.Series(x) for name, x in columns.items()}).write_csv(path)
    return path


@pytest.fixture(scope="module")
def simulated(six_given: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated log with a wrench in the axes of its frame, which the log has with noise."""
    folder = tmp_path_factory.mktemp("measured")
    t = np.arange(0.0, 4.0, STEP)
    size = np.exp(-np.square((t - 2.0) / 0.3))[:, None]
    push = size * [22.0, -20.0, 15.0, 1.0, 0.0, -1.5]
    push[:, 1] *= np.cos(4.0 * t)
    table = pl.DataFrame(np.column_stack([t, push]), schema=["time_s", *AXES])
    table.write_csv(folder / "wrench.csv")
    steelyard.simulate(
        six_given / "demo_arm.toml",
        folder / "run",
        six_given / "validation_motion.json",
        truth=six_given / "truth.json",
        wrench=folder / "wrench.csv",
        wrench_frame=FRAME,
        wrench_axes="frame",
        seed=3,
    )
    return folder / "run" / "log.csv"


@pytest.fixture(scope="module")
def turned(
    simulated: Path, model: steelyard.IdentifiedModel, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The same log with a turned sensor that has a bias and reads the wrench by the robot."""
    log = pl.read_csv(simulated)
    q = log.select([f"q{k}_rad" for k in range(1, 7)]).to_numpy()
    axes = model.pose(q, FRAME)[1]
    true = log.select(AXES).to_numpy()
    base = np.hstack([np.einsum("tij,tj->ti", axes, x) for x in (true[:, :3], true[:, 3:])])
    read = BIAS - read_by_sensor(model, q, base)
    columns = dict(zip(NAMES, read.T, strict=True))
    return written(tmp_path_factory.mktemp("turned") / "turned.csv", simulated, columns)


OPTIONS = ("--frame", FRAME, "--sensor", FLANGE, "--sensor-at", AT, "--sensor-sign", "by_robot")


def test_a_turned_sensor_with_bias_reads_the_wrench_that_was_applied(
    turned: Path, model: steelyard.IdentifiedModel
) -> None:
    plain = steelyard.external_wrench(model, turned, FRAME, measured="auto")
    for at in (AT, (*PLACE, *ANGLES)):
        found = steelyard.external_wrench(
            model, turned, FRAME, measured="ft_{}", sensor=FLANGE, sensor_at=at,
            sensor_sign="by_robot",
        )  # fmt: skip
        assert found.measured is not None and plain.measured is not None
        assert found.measured.sensor.columns == NAMES and plain.measured.sensor.columns == AXES
        assert np.allclose(found.measured.wrench, plain.measured.wrench, atol=0.02)
        assert np.allclose(found.measured.carried.bias, -BIAS, atol=0.02)
        assert not found.measured.warnings
    assert np.array_equal(found.wrench, plain.wrench)


def test_another_place_of_the_sensor_is_named(
    turned: Path, model: steelyard.IdentifiedModel
) -> None:
    found = steelyard.external_wrench(
        model, turned, FRAME, measured="ft_{}", sensor=FLANGE, sensor_sign="by_robot",
        sensor_at=(PLACE[0] + 0.1, PLACE[1], PLACE[2] - 0.3, *ANGLES),
    )  # fmt: skip
    assert found.measured is not None
    (warning,) = found.measured.warnings
    assert "another place of the sensor would fit much better" in warning
    named = warning.split('"')[1].split()
    assert [float(x) for x in named] == pytest.approx([*PLACE, *ANGLES], abs=0.02)


def test_differences_are_those_of_the_table(
    turned: Path, six_identified: Path, command: Command, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    arguments = ("wrench", six_identified, turned, *OPTIONS, "--measured", *NAMES)
    done = command(*arguments, "--json", "-o", out)
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout)["measured"]
    assert printed["columns"] == list(NAMES) and printed["sensor"]["sign"] == "by_robot"
    table = pl.read_csv(out / "wrench.csv")
    for name, row in zip(AXES, printed["components"], strict=True):
        ours, theirs = table[name].to_numpy(), table[f"measured_{name}"].to_numpy()
        apart = ours - theirs
        assert row["mean"] == pytest.approx(np.mean(apart)) and row["unit"] in name
        assert row["std"] == pytest.approx(np.std(apart))
        eq17 = np.abs(apart).sum() / np.abs(theirs - theirs.mean()).sum()
        assert row["relative_absolute"] == pytest.approx(eq17)
        assert row["relative"] == pytest.approx(np.abs(apart).sum() / np.abs(theirs).sum())
        inside = np.abs(apart) <= table[f"half_width_{name}"].to_numpy()
        assert row["within_interval"] == pytest.approx(inside.mean())
    assert printed["components"][0]["relative_absolute"] < 0.2
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("sensor") > 6 and "wrench by the robot" in page
    words = " ".join(command(*arguments).stdout.split())
    assert "of spread" in words and "inside 95 %" in words


def test_axes_of_the_base(turned: Path, model: steelyard.IdentifiedModel) -> None:
    given = {"sensor": FLANGE, "sensor_at": AT, "sensor_sign": "by_robot", "measured": NAMES}
    frame, base = (
        steelyard.external_wrench(model, turned, FRAME, axes=axes, **given).measured
        for axes in ("frame", "base")
    )
    lengths = [np.linalg.norm(one.wrench[:, :3], axis=1) for one in (frame, base)]
    assert np.allclose(*lengths, atol=0.3)
    assert not np.allclose(frame.wrench, base.wrench, atol=2.0)
    assert [x.std for x in base.errors[:3]] == pytest.approx([0.0] * 3, abs=2.5)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sensor_sign": "on_robot"}, "another sign of the sensor would fit much better: with "
         "--sensor-sign by_robot forces differ by"),
        ({"sensor_at": (*PLACE, 0.3, -0.4, 1.1 - 0.5 * np.pi)}, "other axes of the sensor would "
         'fit much better: with --sensor-at "0.01 -0.02 0.05 0.3 -0.4 1.1" forces differ by'),
    ],
)  # fmt: skip
def test_another_sign_or_turn_is_named(
    turned: Path, model: steelyard.IdentifiedModel, change: dict[str, object], words: str
) -> None:
    given = {"sensor": FLANGE, "sensor_at": AT, "sensor_sign": "by_robot", "measured": NAMES}
    found = steelyard.external_wrench(model, turned, FRAME, **given | change)
    assert any(one.startswith(words) for one in found.warnings), found.warnings
    right = steelyard.external_wrench(model, turned, FRAME, **given)
    assert not any("fit much better" in one for one in right.warnings)


@pytest.fixture(scope="module")
def carrying(
    model: steelyard.IdentifiedModel, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Array]:
    """A log that rests in four postures, and the push on the frame in the base's axes."""
    t = np.arange(0.0, 7.0, STEP)
    postures = np.random.default_rng(0).uniform(-1.0, 1.0, (4, 6))
    q = np.tile(postures[0], (len(t), 1))
    for k in range(3):
        phase = np.clip((t - 1.0 - 2.0 * k), 0.0, 1.0)[:, None]
        smooth = phase**3 * (10.0 - 15.0 * phase + 6.0 * phase**2)
        q += smooth * (postures[k + 1] - postures[k])
    dq = np.gradient(q, t, axis=0)
    ddq = np.gradient(dq, t, axis=0)
    push = np.exp(-np.square((t - 3.5) / 0.2))[:, None] * [15.0, -25.0, 10.0, 0.5, -0.5, 1.0]
    external = np.einsum("tij,ti->tj", model.jacobian(q, FRAME), push)
    effort = (model.torque(q, dq, ddq) - external) / model.signals.gains
    position, axes = sensor(model, q)
    centre = position + axes @ CENTRE
    fall = model.robot.gravity - np.gradient(np.gradient(centre, t, axis=0), t, axis=0)
    weight = MASS * np.einsum("tij,ti->tj", axes, fall)
    load = np.hstack([weight, np.cross(CENTRE, weight)])
    read = BIAS + load + read_by_sensor(model, q, push)
    names = {"q{}_rad": q, "dq{}_rad_s": dq, "tau{}_Nm": effort}
    columns = {"time_s": t} | dict(zip(NAMES, read.T, strict=True))
    for name, values in names.items():
        columns |= {name.replace("{}", str(k + 1)): own for k, own in enumerate(values.T)}
    path = tmp_path_factory.mktemp("carrying") / "carrying.csv"
    pl.DataFrame(columns).write_csv(path)
    return path, push


def test_the_weight_of_what_the_sensor_carries_is_taken_off_where_stretches_are_stated(
    carrying: tuple[Path, Array], model: steelyard.IdentifiedModel
) -> None:
    log, push = carrying
    given = {"sensor": FLANGE, "sensor_at": AT, "measured": NAMES, "axes": "base"}
    found = steelyard.external_wrench(model, log, FRAME, sensor_rest=RESTS, **given).measured
    own = found.carried
    assert own.mass == pytest.approx(MASS, abs=2e-3)
    assert own.first_moment == pytest.approx(MASS * CENTRE, abs=2e-4)
    assert own.bias == pytest.approx(BIAS, abs=0.02)
    assert own.duration == pytest.approx(3.2, abs=0.1)
    estimate = steelyard.external_wrench(model, log, FRAME, axes="base")
    true = np.column_stack([np.interp(estimate.t, np.arange(0.0, 7.0, STEP), x) for x in push.T])
    assert np.abs(found.wrench - true).max() < 0.6, "inertia forces of 1.2 kg are taken off too"
    plain = steelyard.external_wrench(model, log, FRAME, **given).measured
    assert plain.carried.mass is None and "weight of what it carries" in plain.words
    assert np.abs(plain.wrench - true).max() > 5.0
    once = steelyard.external_wrench(model, log, FRAME, sensor_rest=RESTS[:1], **given).measured
    assert once.carried.mass is None
    flipped = steelyard.external_wrench(
        model, log, FRAME, sensor_rest=RESTS, sensor_sign="by_robot", **given
    )
    assert any("carries -1.2 kg by its columns" in one for one in flipped.warnings)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--measured", "ft_0", "ft_1", "ft_2", "ft_3", "ft_4", "ft_6"),
         "the log has no column 'ft_6' of a force/torque sensor"),
        (("--measured", "force_{}"), "the log has no column 'force_fx_N'"),
        (("--measured", "ft_0", "ft_1"), "2 columns are named for a force/torque sensor"),
        (("--measured", "ft_{}", "--sensor", "wrist"), "joints lie between it and the frame"),
        (("--measured", "ft_{}", "--sensor", "nose"), "no frame 'nose'"),
        (("--measured", "ft_{}", "--sensor-at", "0 0"), "'0 0' is no place of a sensor"),
        (("--measured", "ft_{}", "--sensor-rest", "5"), "'5' is no stretch of time"),
        (("--measured", "ft_{}", "--sensor-rest", "1.2:1.9"), "does not rest for 0.2 s in the "
         "stated 1.2:1.9 s"),
        (("--sensor-rest", "0:1"), "a sensor is described, but none of its columns is named"),
    ],
)  # fmt: skip
def test_mistakes_of_the_sensor(
    arguments: tuple[str, ...], words: str, turned: Path, six_identified: Path, command: Command
) -> None:
    done = command("wrench", six_identified, turned, *arguments)
    assert done.exit_code == 2 and done.stdout == ""
    assert words in " ".join(done.stderr.split())


def test_the_bias_of_a_robot_that_stands_is_taken_where_it_is_stated(
    model: steelyard.IdentifiedModel, tmp_path: Path
) -> None:
    t, rng = np.arange(0.0, 8.0, STEP), np.random.default_rng(5)
    still = np.tile([0.3, -0.8, 0.9, 0.2, 0.5, -0.1], (len(t), 1))
    q = still + 2e-5 * rng.normal(size=still.shape)
    push = np.where((t > 4.0) & (t < 6.0), 1.0, 0.0)[:, None] * [15.0, -25.0, 10.0, 0.0, 0.0, 0.0]
    external = np.einsum("tij,ti->tj", model.jacobian(still, FRAME), push)
    effort = (model.gravity(still) - external) / model.signals.gains
    read = BIAS + read_by_sensor(model, still, push)
    columns = {"time_s": t} | dict(zip(NAMES, read.T, strict=True))
    for name, values in {"q{}_rad": q, "dq{}_rad_s": 0.0 * q, "tau{}_Nm": effort}.items():
        columns |= {name.replace("{}", str(k + 1)): own for k, own in enumerate(values.T)}
    path = tmp_path / "standstill.csv"
    pl.DataFrame(columns).write_csv(path)
    given = {"sensor": FLANGE, "sensor_at": AT, "measured": NAMES}
    with pytest.raises(steelyard.SteelyardError, match="no joint moves in this log") as refused:
        steelyard.external_wrench(model, path, FRAME, **given)
    assert "--sensor-rest START:STOP" in str(refused.value)
    found = steelyard.external_wrench(model, path, FRAME, sensor_rest=["0:2"], **given).measured
    assert found.carried.bias == pytest.approx(BIAS, abs=0.02)
    nothing = {name: np.full(len(t), own) for name, own in zip(NAMES, BIAS, strict=True)}
    silent = steelyard.external_wrench(
        model, written(tmp_path / "silent.csv", path, nothing), FRAME, sensor_rest=["0:2"], **given
    ).measured
    assert silent is not None and not silent.warnings, "no place explains moments without a force"
    middle = found.wrench[len(found.wrench) * 5 // 8, :3]
    assert np.linalg.norm(middle) == pytest.approx(np.linalg.norm([15.0, -25.0, 10.0]), abs=0.5)


def test_the_sign_is_judged_along_observable_directions(
    six_given: Path, model: steelyard.IdentifiedModel, tmp_path: Path
) -> None:
    shoulder, frame = (body.name for body in model.robot.bodies[1:3])
    log = six_given / "validation.csv"
    (run,) = steelyard.load_runs(six_given / "demo_arm.toml", log)
    t, names = columns_of(log)
    motion = run.whole().motion
    q = np.column_stack([np.interp(t, motion.t, own) for own in motion.q.T])
    pull = model.pose(q, frame)[0] - model.pose(q, shoulder)[0]  # neither joint feels it
    pull = 60.0 * pull / np.linalg.norm(pull, axis=1)[:, None] + [20.0, 20.0, 0.0]
    push = np.exp(-np.square((t - 2.0) / 0.5))[:, None] * np.hstack([pull, 0.0 * pull])
    external = np.einsum("tij,ti->tj", model.jacobian(q, frame), push)
    path = tmp_path / "pushed.csv"
    changed(log, path, dict(zip(names, -(external / model.signals.gains).T, strict=True)))
    read = np.einsum("tij,ti->tj", model.pose(q, frame)[1], push[:, :3])
    columns = dict(zip(NAMES, np.hstack([read, 0.0 * read]).T, strict=True))
    written(path, path, columns)
    right, wrong = (
        steelyard.external_wrench(model, path, frame, measured=NAMES, sensor_sign=sign)
        for sign in ("on_robot", "by_robot")
    )
    assert right.measured is not None and wrong.measured is not None
    assert not right.measured.warnings
    (warning,) = wrong.measured.warnings
    assert warning.startswith("another sign of the sensor would fit much better")
    ours, theirs = right.wrench[:, :3], right.measured.wrench[:, :3]
    far, near = (np.sum(np.square(theirs + sign * ours)) for sign in (1.0, -1.0))
    assert near > 0.25 * far, "most of the difference is not observable"
    for sign in ("on_robot", "by_robot"):  # no direction of the force is observable there
        unseen = steelyard.external_wrench(
            model, path, shoulder, measured=NAMES, sensor=shoulder, sensor_sign=sign
        )
        assert unseen.measured is not None
        assert not any("forces" in one for one in unseen.measured.warnings)


def test_a_window_is_estimated_and_compared_in_the_window_alone(
    turned: Path, model: steelyard.IdentifiedModel
) -> None:
    whole = steelyard.external_wrench(model, turned, FRAME, measured="auto")
    found = steelyard.external_wrench(model, f"{turned}@0.5:2.8", FRAME, measured="auto")
    assert 0.5 <= found.t[0] < 0.6 and 2.7 < found.t[-1] < 2.8
    at = [int(np.argmin(np.abs(one.t - 2.0))) for one in (whole, found)]
    both = [one.measured.wrench[k] for one, k in zip((whole, found), at, strict=True)]
    assert np.allclose(*both, atol=0.5)


def test_a_log_without_rest_at_its_start_is_refused(
    turned: Path, model: steelyard.IdentifiedModel
) -> None:
    with pytest.raises(steelyard.SteelyardError, match="no rest at the start of the log"):
        steelyard.external_wrench(model, f"{turned}@1.3:2.8", FRAME, measured="ft_{}")
