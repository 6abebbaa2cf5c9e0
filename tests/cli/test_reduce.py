"""`steelyard reduce`: what it prints, writes and refuses."""

import json
from collections import Counter
from pathlib import Path
from shutil import copytree, rmtree

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from cli.conftest import Command
from steelyard.base.errors import ModelError, SteelyardError
from steelyard.cli.app import app
from steelyard.estimate.identified_model import load_model
from steelyard.estimate.nonlinear.nonlinear_parameters import information
from steelyard.excite.trajectories.trajectory_files import read_trajectory
from steelyard.export.model_files.export_model_file import exported
from steelyard.identify.reduce import matching, reduce
from steelyard.identify.scores_and_model_report import SECTIONS
from steelyard.robot.file.robot_file import load_robot
from steelyard.runs.runs_of_named_logs import load_runs
from steelyard.simulate.ground_truth import random_truth
from steelyard.simulate.virtual_robot import VirtualRobot, customary_sensors
from steelyard.uses.payload.payload_fit import fit_payload

pytestmark = pytest.mark.usefixtures("searches_here")


@pytest.fixture
def robot(work: Path) -> Path:
    return work.parent / "given" / "demo_arm.toml"


@pytest.fixture
def brief(robot: Path) -> Path:
    """The robot file with a short motion to be designed."""
    text = robot.read_text()
    for usual, short in (("period = 20.0", "period = 5.0"), ("harmonics = 16", "harmonics = 4")):
        assert usual in text
        text = text.replace(usual, short)
    robot.write_text(text)
    return robot


@pytest.fixture
def log(work: Path) -> Path:
    return work.parent / "given" / "identification.csv"


@pytest.fixture
def other(work: Path) -> Path:
    return work.parent / "given" / "validation.csv"


@pytest.mark.slow
def test_what_is_kept_and_removed(
    identified: Path, log: Path, other: Path, command: Command, work: Path
) -> None:
    done = command("reduce", identified, log, "--validate", other, "-o", work / "small", "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    before, after = load_model(identified), load_model(work / "small")
    assert found["removed"] == [vars(one) for one in after.estimate.removed]
    assert found["kept"] == list(after.estimate.parameters.names)
    assert len(found["kept"]) + len(found["removed"]) == len(before.estimate.parameters)
    assert 0 < len(found["removed"])
    chosen = next(m for m in found["models"] if m["parameters"] == len(found["kept"]))
    full = found["models"][0]
    assert chosen["condition"] <= full["condition"]
    assert chosen["unseen_percent"] < 1.05 * full["unseen_percent"]
    assert {p.name for p in (work / "small").iterdir()} == {
        "model.json",
        "parameters.csv",
        "report.html",
    }
    gone = found["removed"][0]["name"]
    assert f"{gone}," in (work / "small" / "parameters.csv").read_text()


@pytest.mark.slow
def test_a_removed_parameter_is_zero_and_not_unknown(
    identified: Path, robot: Path, log: Path, command: Command, work: Path
) -> None:
    assert command("reduce", identified, log, "-o", work / "small").exit_code == 0
    small = load_model(work / "small")
    removed = {one.name for one in small.estimate.removed}
    assert not removed & {one.name for one in small.estimate.blind}
    runs = [information(small.model, [one]) for one in load_runs(robot, log)]
    weight = fit_payload(small, runs)
    assert abs(weight.mass) < 2.0 * weight.half_width[0]


@pytest.mark.slow
def test_bodies_that_can_exist(
    identified: Path, robot: Path, log: Path, other: Path, command: Command, work: Path
) -> None:
    options = ("--bodies", "--robot", robot, "--each", "-o", work / "small")
    assert command("reduce", identified, log, other, *options).exit_code == 0
    small = load_model(work / "small")
    rows = (work / "small" / "repeated.csv").read_text().splitlines()[1:]
    assert [row.partition(",")[0] for row in rows] == list(small.estimate.parameters.names)
    estimate, base = small.estimate, small.base
    assert estimate.standard is not None and estimate.removed
    lifted = dict(
        zip(base.base_names, base.lift @ estimate.standard.parameters.values, strict=True)
    )
    scale = np.abs(list(lifted.values())).max()
    for one in estimate.removed:
        if one.name in lifted:
            assert abs(lifted[one.name]) < 1e-6 * scale
    assert exported(small, "urdf").text


@pytest.mark.slow
def test_friction_of_moving_joints_stays_with_a_tolerance(
    identified: Path, log: Path, command: Command
) -> None:
    done = command("reduce", identified, log, "--stop", "tolerance=300", "--json")
    assert done.exit_code == 0, done.output
    kept = set(json.loads(done.stdout)["kept"])
    names = load_model(identified).estimate.parameters.names
    friction = {name for name in names if name.startswith(("coulomb", "viscous"))}
    assert friction and friction <= kept


def test_mean_absolute_errors_and_an_empty_essential_set(
    identified: Path, log: Path, command: Command, work: Path
) -> None:
    options = ("--criterion", "mean_column", "--stop", "tolerance=300", "--error", "mean_absolute")
    done = command("reduce", identified, log, *options, "--essential", "none", "-o", "a", "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    friction = ("coulomb", "viscous")
    assert any(one["name"].startswith(friction) for one in found["removed"])
    assert found["joint_errors"]["measure"] == "mean_absolute"
    for joint in found["joint_errors"]["joints"]:
        assert joint["full"] < joint["reduced"] <= 4.0 * joint["full"]
        effort = 100.0 * joint["full"] / joint["full_percent"]
        assert 100.0 * joint["reduced"] / joint["reduced_percent"] == pytest.approx(effort)
    kept = json.loads(command("reduce", identified, log, *options, "-o", "b", "--json").stdout)
    names = [row["name"] for row in found["parameter_comparison"]]
    assert {name for name in names if name.startswith(friction)} <= set(kept["kept"])


def test_both_models_are_shown_with_standard_deviations(
    identified: Path, log: Path, command: Command, work: Path
) -> None:
    done = command("reduce", identified, log, "--stop", "one_fewer", "-o", work / "a")
    page = (work / "a" / "report.html").read_text(encoding="utf-8")
    for caption in ("Parameters", "Errors"):
        words = f"{caption} of the full and the reduced model"
        assert words in " ".join(done.output.split()) and words in page
    whole = reduce(identified, log, stop="refit").model.estimate
    fewer = reduce(identified, log, stop="one_fewer")
    rows = fewer.parameter_comparison.to_dicts()
    assert rows == fewer.to_dict()["parameter_comparison"]
    assert [row["name"] for row in rows] == list(whole.parameters.names)
    for label, one in (("full", whole), ("reduced", fewer.model.estimate)):
        known = {row["name"]: row for row in rows if row[label] is not None}
        assert list(known) == list(one.parameters.names)
        for name, value, std in zip(known, one.parameters.values, one.std, strict=True):
            row = known[name]
            assert row[label] == pytest.approx(value)
            assert row[f"{label}_std"] == pytest.approx(std)
            relative = pytest.approx(100.0 * std / abs(value))
            assert row[f"{label}_relative_std_percent"] == relative
    removed = [row["name"] for row in rows if row["reduced"] is None]
    assert removed == [fewer.model.estimate.removed[0].name]
    assert fewer.joint_errors.to_dicts() == fewer.to_dict()["joint_errors"]["joints"]


@pytest.mark.slow
def test_the_mean_over_repetitions_is_reduced(
    robot: Path, log: Path, command: Command, work: Path
) -> None:
    rows = np.genfromtxt(log, delimiter=",", names=True)
    names, once = rows.dtype.names, np.array(rows.tolist())
    assert names is not None and names[0] == "time_s"
    several = np.tile(once, (4, 1))
    step = (once[-1, 0] - once[0, 0]) / (len(once) - 1)
    several[:, 0] = step * np.arange(len(several))
    random = np.random.default_rng(0)
    for k, name in enumerate(names):
        if name.startswith("tau"):
            several[:, k] += 0.05 * random.standard_normal(len(several))
    np.savetxt("several.csv", several, delimiter=",", header=",".join(names), comments="")
    robot.write_text(robot.read_text() + '\n[processing]\nrepetitions = "find"\n')
    options = ("--method", "WLS", "--no-check", "-o", work / "full")
    done = command("identify", robot, "several.csv", *options)
    assert done.exit_code in (0, 1), done.output
    done = command("reduce", work / "full", "several.csv", "--stop", "refit", "-o", work / "again")
    assert done.exit_code in (0, 1), done.output
    first, again = (load_model(work / name).estimate for name in ("full", "again"))
    np.testing.assert_array_equal(again.n_samples, first.n_samples)
    assert again.parameters.names == first.parameters.names
    np.testing.assert_allclose(again.parameters.values, first.parameters.values, rtol=1e-9)
    np.testing.assert_allclose(again.std, first.std, rtol=1e-9)


@pytest.mark.slow
def test_logs_of_one_motion_are_named(
    identified: Path, log: Path, other: Path, command: Command, work: Path
) -> None:
    table = pl.read_csv(log)
    efforts = [name for name in table.columns if name.startswith("tau")]
    noise = np.random.default_rng(0).normal(scale=0.01, size=(len(efforts), len(table)))
    noisy = {name: table[name] + row for name, row in zip(efforts, noise, strict=True)}
    table.with_columns(**noisy).write_csv(work / "again.csv")
    says = "all logs repeat the motion of identification"
    done = command("reduce", identified, log, work / "again.csv", "-o", work / "one")
    assert done.exit_code == 0 and says in " ".join(done.output.split())
    done = command("reduce", identified, log, other, "-o", work / "two")
    assert done.exit_code == 0 and "all logs repeat" not in " ".join(done.output.split())


def test_keep_and_drop_by_pattern(identified: Path, log: Path, command: Command) -> None:
    names = load_model(identified).estimate.parameters.names
    offsets = [name for name in names if name.startswith("offset")]
    done = command(
        *("reduce", identified, log, "--drop", "offset.*", "--stop", f"count={len(names) - 8}"),
        *("--keep", "viscous.*", "coulomb.*", "--json"),
    )
    assert done.exit_code == 0, done.output
    removed = [one["name"] for one in json.loads(done.stdout)["removed"]]
    assert set(removed[: len(offsets)]) == set(offsets)
    terms = [term.law for term in load_model("steelyard-reduced").model.terms]
    assert "offset" not in terms


@pytest.mark.slow
def test_a_reduced_model_is_reduced_further(
    identified: Path, log: Path, command: Command, work: Path
) -> None:
    first = command("reduce", identified, log, "--stop", "one_fewer", "-o", "a", "--json")
    second = command("reduce", "a", log, "--stop", "one_fewer", "-o", "b", "--json")
    again = command("reduce", "b", log, "--stop", "refit", "-o", "c", "--json")
    one, two, three = (json.loads(done.stdout)["removed"] for done in (first, second, again))
    assert two[:1] == one and three == two
    assert [entry["step"] for entry in two] == [1, 2]


@pytest.fixture(scope="module")
def six_fewer(
    identified: Path, given: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, list[str]]:
    """A model without six of its parameters, and their names."""
    out = tmp_path_factory.mktemp("fewer") / "small"
    count = len(load_model(identified).estimate.parameters) - 6
    log = str(given / "identification.csv")
    arguments = ["reduce", str(identified), log, "--stop", f"count={count}", "-o", str(out)]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    return out, [one.name for one in load_model(out).estimate.removed]


@pytest.mark.slow
@pytest.mark.parametrize("stop", ["one_standard_error", "tolerance=300", "refit"])
def test_what_was_removed_before_stays_removed(
    stop: str, six_fewer: tuple[Path, list[str]], identified: Path, log: Path, command: Command
) -> None:
    names = load_model(identified).estimate.parameters.names
    first, gone = six_fewer
    second = command("reduce", first, log, "--stop", stop, "-o", "b", "--json")
    two = json.loads(second.stdout)
    assert second.exit_code == 0, second.output
    removed = [entry["name"] for entry in two["removed"]]
    assert len(gone) == 6 and removed[:6] == gone
    assert not set(removed) & set(two["kept"])
    assert sorted([*removed, *two["kept"]]) == sorted(names)
    assert two["models"][0]["parameters"] == len(names) - 6


@pytest.mark.parametrize("stop", ["one_standard_error", "condition=1e9", "refit"])
def test_what_is_to_be_dropped_is_dropped(
    stop: str, identified: Path, log: Path, command: Command
) -> None:
    done = command(
        "reduce", identified, log, "--drop", "viscous.elbow", "--stop", stop, "-o", "a", "--json"
    )
    found = json.loads(done.stdout)
    assert found["removed"][0]["name"] == "viscous.elbow"
    assert "viscous.elbow" not in found["kept"]
    assert found["models"][0]["parameters"] == len(found["kept"]) + len(found["removed"]) - 1


def test_the_contribution_of_every_parameter_is_printed(
    identified: Path, log: Path, command: Command, work: Path
) -> None:
    options = ("--criterion", "contribution", "--stop", "one_fewer")
    done = command("reduce", identified, log, *options, "-o", work / "a")
    assert done.exit_code == 0, done.output
    assert "Relative contribution by parameter" in done.output
    page = (work / "a" / "report.html").read_text(encoding="utf-8")
    assert "Relative contribution by parameter" in page
    shown = reduce(identified, log, criterion="contribution", stop="one_fewer")
    rows = shown.to_dict()["criterion"]["parameters"]
    assert shown.criterion_table.to_dicts() == rows
    assert [row["step"] for row in rows] == [1] + [None] * (len(rows) - 1)
    assert rows[0]["last"] == rows[0]["before"] == min(row["before"] for row in rows)
    assert sum(row["before"] for row in rows) == pytest.approx(1.0)
    assert sum(row["last"] for row in rows[1:]) == pytest.approx(1.0)
    for row in rows:
        assert row["name"] in done.output


def test_joints_weigh_the_same_where_it_is_asked_for(
    identified: Path, log: Path, command: Command, work: Path
) -> None:
    options = ("--stop", "refit", "--weights", "equal")
    assert command("reduce", identified, log, *options, "-o", work / "a").exit_code == 0
    printed = load_model(work / "a").estimate
    weighted = reduce(identified, log, stop="refit").model.estimate
    assert printed.estimator.startswith("reduced ordinary least squares")
    assert not np.allclose(printed.parameters.values, weighted.parameters.values)


def test_every_field_of_the_json_output_has_one_section(identified: Path, log: Path) -> None:
    content = reduce(identified, log, stop="one_fewer").content
    fields = Counter(field for section in SECTIONS for field in section.to_dict(content))
    assert {"kept", "criterion", "models", "joint_errors"} <= fields.keys()
    assert [field for field, number in fields.items() if number > 1] == []


def test_only_a_star_stands_for_letters() -> None:
    names = ("mass[1]", "mass1", "mass2")
    assert matching(["mass[1]"], names, "--keep") == ("mass[1]",)
    assert matching(["mass*"], names, "--keep") == names
    with pytest.raises(ModelError, match=r"no base parameter matches 'mass\?'"):
        matching(["mass?"], names, "--keep")


def test_a_model_of_one_parameter_is_small_enough(
    identified: Path, log: Path, command: Command
) -> None:
    done = command("reduce", identified, log, "--stop", "count=1", "-o", "a")
    assert done.exit_code == 1 and "POOR" in done.output  # and written all the same
    done = command("reduce", "a", log, "--stop", "one_fewer", "-o", "b")
    assert done.exit_code == 2 and "it has one parameter" in done.output


@pytest.mark.slow
def test_the_terminal_counts_what_is_left(identified: Path, log: Path, command: Command) -> None:
    names = load_model(identified).estimate.parameters.names
    command("reduce", identified, log, "--stop", f"count={len(names) - 2}", "-o", "a")
    done = command("reduce", "a", log, "--stop", "one_fewer", "-o", "b")
    words = " ".join(done.stdout.split())
    left = len(names) - 2
    assert f"{left - 1} of {left} parameters kept, 1 removed (2 more before)" in words
    assert f"{left - 1} base parameters: " in words
    assert "; 3 removed, taken as zero" in words


@pytest.mark.slow
def test_the_next_motion_is_of_the_smaller_model(
    identified: Path, brief: Path, log: Path, command: Command, work: Path
) -> None:
    options = ("--robot", brief, "--next", "motion", "--budget", 1, "--stop", "one_fewer")
    done = command("reduce", identified, log, *options, "-o", "small")
    assert done.exit_code == 0, done.output
    assert "motion/trajectory.json" in done.stdout
    again = ("--robot", brief, "--last", "motion/trajectory.json", "--budget", 1)
    again += ("--stop", "one_fewer")
    options = ("--next", "motion2", "--limit", 1e6, "-o", "smaller")
    done = command("reduce", "small", log, *again, *options)
    assert done.exit_code == 0, done.output
    assert load_robot(brief).robot.n == load_model("smaller").model.robot.n
    words = " ".join(done.output.split())
    assert "at most 1e+06: the reduction is finished" in words

    # its condition number is that of the regressor along the motion that was written
    small = load_model("smaller")
    motion = read_trajectory(Path("motion2/trajectory.json"), load_robot(brief))
    end = motion.duration * (1.0 - 1e-9)
    values = motion.sample(np.linspace(0.0, end, 20_000))
    nominal, base = small.model.prior, small.base
    assert nominal is not None
    kept = [base.base_names.index(name) for name in small.estimate.parameters.names]
    columns = nominal.regressor(values)[:, :, [base.independent[k] for k in kept]]
    singular = np.linalg.svd(columns.reshape(-1, len(kept)), compute_uv=False)
    options = ("--next", "motion3", "--limit", 1, "-o", "smallest", "--json")
    shown = float(words.partition("(not normalised): ")[2].split()[0])
    assert shown == pytest.approx(singular[0] / singular[-1], rel=0.01)
    done = command("reduce", "small", log, *again, *options)
    found = json.loads(done.stdout)["next"]
    assert found["limit"] == 1.0 and found["finished"] is False and found["condition"] > 1.0


@pytest.mark.slow
def test_the_loop_goes_on_where_it_was_interrupted(
    brief: Path, work: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from steelyard.excite.excite_and_reduce_loop import reduction_loop

    arm = load_robot(brief).robot
    truth = random_truth(arm, 0)
    rig = VirtualRobot(arm, truth, customary_sensors(arm, truth))
    options = {"limit": 1.0, "budget": 1.0, "searches": 1, "processes": 1}
    rounds = reduction_loop(brief, rig, work / "rounds", rounds=2, check=False, **options)
    assert [len(one.removed) for one in rounds] == [0, 1]
    assert rounds[1].condition <= rounds[0].condition

    class Broken:
        def send(self, trajectory: object) -> None:
            raise AssertionError("the robot was run again")

        record = rig.record

    copytree(work / "rounds", work / "again")
    again = reduction_loop(brief, Broken(), work / "again", rounds=2, check=False, **options)
    assert [one.condition for one in again] == [one.condition for one in rounds]
    assert again[1].removed == rounds[1].removed

    # the log is that of a robot whose efforts count the other way: refused unless not checked
    rmtree(work / "again" / "round_00" / "model")
    signs = 'kind = "joint_torque"\ngain = [-1.0, -1.0, -1.0]'
    brief.write_text(brief.read_text().replace('kind = "joint_torque"', signs))
    # (before the fit, or after it where the motion found within the budget leaves the sign open;
    # some motions do not distinguish it from that of all positions)
    refused = "effort sign|efforts have the (wrong|opposite) sign"
    with pytest.raises(SteelyardError, match=refused):
        reduction_loop(brief, Broken(), work / "again", rounds=1, **options)
    (only,) = reduction_loop(brief, Broken(), work / "again", rounds=1, check=False, **options)
    assert len(only.model.estimate.parameters) == len(rounds[0].model.estimate.parameters)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--keep", "vicous.*"), "no base parameter matches 'vicous.*'"),
        (("--drop", "nothing"), "no base parameter matches 'nothing'"),
        (("--keep", "*"), "there is nothing to remove"),
        (("--drop", "*"), "all parameters that the data show are to be removed"),
        (("--drop", "viscous.*", "--stop", "count=500"), "no model has 500 parameters"),
        (("--keep", "viscous.*", "--drop", "viscous.*"), "is to be kept and to be removed"),
        (("--stop", "tolerance=-1"), "is no number that stopping rule"),
        (("--stop", "condition=0.5"), "no model has a condition number"),
        (("--stop", "bic", "--error", "mean_absolute"), "compares no mean absolute errors"),
        (("--criterion", "los"), "there is no criterion 'los'"),
        (("--bodies",), "--bodies without a robot file"),
        (("--last", "x.json"), "--last is given, but no motion is designed"),
        (("--limit", "100"), "--limit is given, but no motion is designed"),
    ],
)
def test_bad_input(
    options: tuple[str, ...], words: str, identified: Path, log: Path, command: Command, work: Path
) -> None:
    done = command("reduce", identified, log, *options, "-o", work / "small")
    assert done.exit_code == 2
    assert words in " ".join(done.output.split())
    assert "fix" in done.output
    assert not (work / "small").exists()


@pytest.mark.slow
def test_a_log_that_the_given_model_does_not_describe_is_named(
    identified: Path, log: Path, command: Command
) -> None:
    rows = pl.read_csv(log, comment_prefix="#")
    turned = [pl.col(name).neg() for name in rows.columns if name.startswith("tau")]
    assert len(turned) == 3
    rows.with_columns(turned).write_csv("turned.csv")
    done = command("reduce", identified, "turned.csv", "--stop", "one_fewer", "-o", "a")
    words = " ".join(done.output.split())
    assert "! the given model predicts turned with an error of" in words
    assert f"steelyard validate {identified} turned.csv" in words and "FAIR: " in words
    done = command("reduce", identified, log, "--stop", "one_fewer", "-o", "b")
    assert "the given model" not in done.output


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--last", "nosuch.json"), "the file does not exist where nosuch.json"),
        (("--last", "other.csv"), "no motion of kind 'fourier' as the robot file describes it"),
        (("--robot", "other.toml"), "this robot first, second"),
        (("--robot", "other.toml", "--bodies"), "this robot first, second"),
        (("--next", "small"), "the motion's folder is that of the reduced model (small)"),
        (("--next", "at", "-o", "at/small"), "or contains it where --next at"),
    ],
)
def test_a_next_motion_that_cannot_be_is_refused_before_the_reduction(
    options: tuple[str, ...],
    words: str,
    identified: Path,
    brief: Path,
    log: Path,
    command: Command,
    work: Path,
) -> None:
    names = ",".join(f"q{k}" for k in range(1, load_robot(brief).robot.n + 1))
    rows = [",".join([f"{t}", *["0.0"] * (names.count(",") + 1)]) for t in range(4)]
    Path("other.csv").write_text("\n".join([f"time_s,{names}", *rows]))
    Path("other.toml").write_text(OTHER_ROBOT)
    given = {"--robot": brief, "--next": "motion", "-o": "small"}
    usual = [x for option, value in given.items() if option not in options for x in (option, value)]
    done = command("reduce", identified, log, *usual, *options)
    assert done.exit_code == 2
    assert words in " ".join(done.output.split()) and "fix" in done.output
    assert not Path("small").exists() and not Path("at").exists()


OTHER_ROBOT = """
[robot]
name = "other"

[robot.dh]
convention = "standard"
links = [{ joint = "first", a = 0.4 }, { joint = "second", a = 0.4 }]

[robot.limits]
first = { lower = -1.0, upper = 1.0, velocity = 1.0, effort = 10.0 }
second = { lower = -1.0, upper = 1.0, velocity = 1.0, effort = 10.0 }

[model]
terms = ["rigid_body"]

[signals]
time = "time_s"
position = "q{}_rad"
[signals.effort]
columns = "tau{}_Nm"
kind = "joint_torque"
unit = "Nm"
"""
