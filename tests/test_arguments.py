"""Wrong arguments of the Python interface: errors that say what, where, and how to correct it."""

import copy
import pickle
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import steelyard
from steelyard.base.errors import SteelyardError
from steelyard.base.progress import Stopped, report_progress
from steelyard.check.check import CorrectedFile
from steelyard.identify.scores_and_model_report import CSV_COLUMNS
from test_interface import folder as folder

NAN = float("nan")
WRONG: dict[str, tuple[Callable[[Path], Any], str]] = {
    "no log": (lambda f: steelyard.identify(f / "arm.toml", []), "no log is given"),
    "no log to check": (lambda f: steelyard.check(f / "arm.toml", []), "no log is given"),
    "no log to compare": (lambda f: steelyard.compare(f / "arm.toml", []), "no log is given"),
    "no log to load": (lambda f: steelyard.load_runs(f / "arm.toml", []), "no log is given"),
    "nothing to validate on": (lambda f: steelyard.validate(f / "arm-model", []), "no log is"),
    "None as logs": (lambda f: steelyard.load_runs(f / "arm.toml", None), "'logs' cannot be None"),  # type: ignore[arg-type]
    "a table as log": (lambda f: steelyard.identify(f / "arm.toml", [5]), "'logs' cannot be list"),  # type: ignore[list-item]
    "a set of numbers": (lambda f: steelyard.identify(f / "arm.toml", {5}), "a int is no log"),  # type: ignore[arg-type]
    "a number as method": (
        lambda f: steelyard.identify(f / "arm.toml", f / "fit.csv", method=5),  # type: ignore[arg-type]
        "'method' cannot be 5",
    ),
    "an empty method": (
        lambda f: steelyard.identify(f / "arm.toml", f / "fit.csv", method=""),
        "no estimator ''",
    ),
    "too few draws": (
        lambda f: steelyard.identify(f / "arm.toml", f / "fit.csv", bootstrap=0),
        "'bootstrap' cannot be 0",
    ),
    "True as a number": (
        lambda f: steelyard.identify(f / "arm.toml", f / "fit.csv", bootstrap=True),
        "'bootstrap' cannot be True",
    ),
    "a text as a switch": (
        lambda f: steelyard.identify(f / "arm.toml", f / "fit.csv", check="no"),  # type: ignore[arg-type]
        "'check' cannot be 'no'",
    ),
    "negative threads": (
        lambda f: steelyard.identify(f / "arm.toml", f / "fit.csv", threads=-1),
        "'threads' cannot be -1",
    ),
    "one name as a list": (
        lambda f: steelyard.compare(f / "arm.toml", f / "fit.csv", "WLS"),
        "'estimators' cannot be 'WLS'",
    ),
    "no budget": (
        lambda f: steelyard.design_excitation(f / "arm.toml", budget=NAN),
        "'budget' cannot be nan",
    ),
    "patterns as a switch": (
        lambda f: steelyard.design_excitation(f / "arm.toml", still_unknown=["m.*"]),  # type: ignore[arg-type]
        "'still_unknown' cannot be list",
    ),
    "negative noise": (
        lambda f: steelyard.simulate(f / "arm.toml", f / "new", noise=-1.0),
        "'noise' cannot be -1.0",
    ),
    "half a period": (
        lambda f: steelyard.simulate(f / "arm.toml", f / "new", periods=1.5),  # type: ignore[arg-type]
        "'periods' cannot be 1.5",
    ),
    "negative seed": (
        lambda f: steelyard.simulate(f / "arm.toml", f / "new", seed=-1),
        "'seed' cannot be -1",
    ),
    "negative mass": (
        lambda f: steelyard.simulate(f / "arm.toml", f / "new", payload_mass=-1.0),
        "'payload_mass' cannot be -1.0",
    ),
    "motion and period": (
        lambda f: steelyard.simulate(
            f / "arm.toml", f / "new", f / "fit" / "trajectory.json", period=3.0
        ),
        "together with a motion",
    ),
    "no run": (lambda f: steelyard.information(steelyard.model_of(f / "arm.toml"), []), "no run"),
    "a file as model": (lambda f: steelyard.base_parameters("arm.toml"), "'model' cannot be"),  # type: ignore[arg-type]
    "names as terms": (
        lambda f: steelyard.Model(steelyard.load_robot(f / "arm.urdf").robot, ("viscous",)),  # type: ignore[arg-type]
        "'viscous' is no term",
    ),
    "a loaded robot as robot": (
        lambda f: steelyard.Model(steelyard.load_robot(f / "arm.urdf"), ()),  # type: ignore[arg-type]
        "is no robot",
    ),
    "samples of two lengths": (
        lambda f: steelyard.Motion([0.0, 1.0], [[0.0]], [[0.0]], [[0.0]]),
        r"'q' has shape \(1, 1\)",
    ),
    "a column too many": (
        lambda f: steelyard.Motion([0.0], [[0.0]], [[0.0, 0.0]], [[0.0]]),
        r"'dq' has shape \(1, 2\)",
    ),
    "no number": (lambda f: steelyard.Motion([0.0], [[NAN]], [[0.0]], [[0.0]]), "'q' holds"),
    "ragged rows": (
        lambda f: steelyard.Motion([0], [[0], [0, 1]], [[0]], [[0]]),
        "'q' is no array",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments_are_explained(case: str, folder: Path) -> None:
    call, words = WRONG[case]
    with pytest.raises(SteelyardError, match=words) as caught:
        call(folder)
    assert caught.value.where and caught.value.fix
    assert not (folder / "new").exists()


def test_tracebacks_end_at_the_interface_unless_all_frames_are_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "broken.parquet"
    log.write_text("no parquet")

    def raised() -> tuple[list[str], str]:
        with pytest.raises(SteelyardError) as caught:
            steelyard.open_log(log)
        files = [Path(frame.filename).name for frame in traceback.extract_tb(caught.tb)]
        return files, "".join(traceback.format_exception(caught.value))

    monkeypatch.setenv("STEELYARD_TRACEBACK", "1")
    whole, text = raised()
    assert (
        whole[:3] == ["test_arguments.py", "checked_arguments.py", "formats.py"] and len(whole) > 3
    )
    assert text.count("Traceback") == 2 and "\nValueError: " in text
    monkeypatch.delenv("STEELYARD_TRACEBACK")
    short, text = raised()
    assert short == ["test_arguments.py", "checked_arguments.py"]
    assert text.count("Traceback") == 1 and "all frames: STEELYARD_TRACEBACK=1" in text
    assert f"\n  where  {log}\n  fix    " in text and "\nValueError: " not in text


MODEL_WRONG: dict[str, tuple[Callable[[Any], Any], str]] = {
    "scalar": (lambda m: m.gravity(0.0), r"'q' has shape \(\)"),
    "three joints": (lambda m: m.mass_matrix(np.zeros((4, 3))), r"'q' has shape \(4, 3\)"),
    "cube": (lambda m: m.gravity(np.zeros((4, 3, 2))), "'q' has shape"),
    "words": (lambda m: m.gravity("ab"), "'q' is no array"),
    "no number": (lambda m: m.mass_matrix([NAN, 0.0]), "'q' holds"),
    "two shapes": (lambda m: m.bias(np.zeros((4, 2)), [0.0, 0.0]), "'dq' has shape"),
    "overflow": (lambda m: m.bias([0.0, 0.0], [1e200, 0.0]), "a value of the bias is not finite"),
    "an array": (lambda m: m.torque(np.zeros((4, 2))), "ndarray alone is no motion"),
    "step without a number": (
        lambda m: m.start().step([0.0, 0.0], [NAN, 0.0], [0.0, 0.0]),
        "'dq' holds a value that is not finite",
    ),
    "step of words": (lambda m: m.start().step(["a", "b"], [0, 0], [0, 0]), "type <U1"),
}


@pytest.mark.parametrize("case", MODEL_WRONG)
def test_wrong_states_are_explained(case: str, folder: Path) -> None:
    call, words = MODEL_WRONG[case]
    with pytest.raises(SteelyardError, match=words):
        call(steelyard.load_model(folder / "arm-model"))


def test_values_can_be_pickled_and_copied(folder: Path) -> None:
    model = steelyard.load_model(folder / "arm-model")
    rest = steelyard.Motion([0.0], [[0.1, 0.2]], [[0.0, 0.0]], [[0.0, 0.0]])
    torque = model.torque(rest)
    for again in (pickle.loads(pickle.dumps(model)), copy.deepcopy(model)):
        np.testing.assert_array_equal(again.torque(rest), torque)
    loaded = steelyard.load_robot(folder / "arm.toml")
    assert pickle.loads(pickle.dumps(loaded)).reference == loaded.reference
    with pytest.raises(SteelyardError) as caught:
        steelyard.load_robot(folder / "none.urdf")
    again = pickle.loads(pickle.dumps(caught.value))
    assert str(again) == str(caught.value) and type(again) is type(caught.value)


@pytest.mark.usefixtures("searches_here")
def test_a_designed_motion_can_be_pickled(folder: Path, tmp_path: Path) -> None:
    robot = tmp_path / "arm.toml"
    robot.write_text(
        f'[robot]\nurdf = "{folder / "arm.urdf"}"\n'
        "[excitation.limits]\npower = 200.0\n"
        "[excitation.workspace]\nfloor = -3.0\nonly_tool = true\n"
        "box = {x = [-2.0, 2.0]}\nkeep_out = [{x = [2.0, 3.0], y = [0.0, 1.0], z = [1.5, 2.0]}]\n"
    )
    made = steelyard.design_excitation(robot, budget=1.0, searches=1, processes=1)
    again = pickle.loads(pickle.dumps(made))
    assert again.to_dict() == made.to_dict()
    motion = made.trajectory.sample(np.linspace(0.0, made.trajectory.duration, 7))
    assert len(made.designed.constraints) >= 4
    for before, after in zip(made.designed.constraints, again.designed.constraints, strict=True):
        state = (motion.q, motion.dq, motion.ddq)
        np.testing.assert_array_equal(after.margins(*state).values, before.margins(*state).values)


@pytest.mark.slow
def test_robots_and_models_are_accepted_as_read(folder: Path) -> None:
    robot = steelyard.load_robot(folder / "arm.toml")
    found = steelyard.identify(robot, folder / "fit.csv")
    np.testing.assert_array_equal(
        found.model.estimate.parameters.values,
        steelyard.load_model(folder / "arm-model").estimate.parameters.values,
    )
    assert steelyard.load_robot(robot) is robot
    assert steelyard.load_model(found.model) is found.model


def test_a_watcher_without_an_answer_does_not_stop_the_work() -> None:
    report_progress(lambda event: None, "reading", 0, 1)  # type: ignore[arg-type, return-value]
    with pytest.raises(Stopped):
        report_progress(lambda event: False, "reading", 0, 1)


def test_a_robot_file_without_changes_is_not_saved(folder: Path) -> None:
    found = steelyard.check(folder / "arm.toml", folder / "fit.csv", fix=folder / "new.toml")
    assert isinstance(found.fixed, CorrectedFile) and not found.fixed.changes
    with pytest.raises(SteelyardError, match="nothing was changed"):
        found.fixed.save()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "ignored"),
    [("WLS", True), ("Huber", True), ("least_squares", False), ("OLS", False), ("SDP", False)],
)
def test_weights_that_an_estimator_does_not_use_are_noted(
    method: str, ignored: bool, folder: Path, tmp_path: Path
) -> None:
    robot = tmp_path / "arm.toml"
    robot.write_text(
        f'[robot]\nurdf = "{folder / "arm.urdf"}"\n'
        f'[estimation]\nmethod = "{method}"\nweights = "equal"\n'
    )
    found = steelyard.identify(robot, folder / "fit.csv", check=False)
    noted = [note for note in found.content.notes if "does not use [estimation] weights" in note]
    assert bool(noted) == ignored


def test_a_check_and_a_run_are_one_line(folder: Path) -> None:
    robot, log = folder / "arm.toml", folder / "fit.csv"
    (run,) = steelyard.load_runs(robot, log)
    assert repr(run) == (
        f"Run('fit': 2 joints, {run.n_samples} samples at {run.rate:g} Hz, {run.duration:.4g} s)"
    )
    found = steelyard.check(robot, log, quick=True)
    assert repr(found).startswith(f"CheckResult({robot}: ") and "\n" not in repr(found)
    assert " checks: " in repr(found)


def test_a_whole_run_has_a_row_per_sample(folder: Path) -> None:
    (run,) = steelyard.load_runs(folder / "arm.toml", folder / "fit.csv")
    data = run.whole()
    assert data.motion.q.shape == data.effort.shape == data.moving.shape == (run.n_samples, 2)
    assert data.t.shape == data.segment.shape == (run.n_samples,)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"validat": "x"}, "steelyard.identify: .*'validat'; did you mean 'validate'"),
        ({}, "steelyard.identify: missing a required argument: 'logs'"),
    ],
)
def test_unknown_arguments_name_the_function(arguments: dict[str, str], words: str) -> None:
    given = ("arm.toml", "log.csv") if arguments else ("arm.toml",)
    with pytest.raises(TypeError, match=words):
        steelyard.identify(*given, **arguments)


def test_a_wrong_shape_states_the_expected_one_first() -> None:
    with pytest.raises(SteelyardError) as caught:
        steelyard.Motion(np.zeros(5), np.zeros(5), np.zeros((5, 2)), np.zeros((5, 2)))
    assert str(caught.value).splitlines()[0] == "'q' has shape (5,), expected: (5, n)"


def test_parameters_of_a_saved_model_have_intervals(folder: Path) -> None:
    model = steelyard.load_model(folder / "arm-model")
    table = steelyard.parameter_table(model)
    assert table["name"].to_list() == list(model.base.base_names)
    assert sorted(table.columns) == sorted(CSV_COLUMNS)
    printed = str(table)
    for column in ("value", "std", "lower95", "upper95", "status"):
        assert f" {column} " in printed
    seen = table.filter(table["value"].is_not_null())
    assert (seen["upper95"] - seen["lower95"]).to_numpy() == pytest.approx(
        2.0 * 1.96 * seen["std"].to_numpy(), rel=1e-3
    )


def test_a_model_is_a_path_or_a_model() -> None:
    with pytest.raises(steelyard.SteelyardError, match="load_model"):
        steelyard.load_model(3)  # type: ignore[arg-type]
