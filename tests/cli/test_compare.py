"""`steelyard compare`: by runs and by stretches, what it writes, mistakes, and Ctrl-C."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from cli.conftest import results
from cli.mistakes import leftovers
from cli.river_files import edited
from cli.test_interrupt import pressed_here
from steelyard.estimate.estimator_register import ESTIMATORS, method_of
from steelyard.identify.comparison.compare import offers_of
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.sections import EstimationSection

LOG = "../given/identification.csv"
OTHER = "../given/validation.csv"
ROBOT = "../given/demo_arm.toml"
SOME = ("OLS", "WLS", "ridge")


def words(text: str) -> str:
    return " ".join(text.replace("\u00a0", " ").split())


@pytest.mark.slow
def test_runs_are_left_out_in_turn(command, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = command("compare", ROBOT, LOG, OTHER, "--estimators", "wls,OLS", "-o", out)
    assert done.exit_code == 0, done.output
    text = words(done.output)
    assert (
        "Each estimator is fitted to all but one run and predicts that one, for each of the 2."
        in text
    )
    assert "Recommended: WLS" in text and "compare.html" in text
    assert sorted(p.name for p in out.iterdir()) == ["compare.html", "compare.json"]
    found = json.loads((out / "compare.json").read_text())
    assert [one["estimator"] for one in found["estimators"]] == ["WLS", "OLS"]
    assert found["left_out"] == "run"
    page = (out / "compare.html").read_text()
    assert "Estimators compared" in page and "Data quality" in page


@pytest.mark.slow
def test_errors_are_those_of_a_validation(command, identified: Path) -> None:
    """The model of one log, scored on the other where joints move."""
    done = command("compare", ROBOT, LOG, OTHER, "--estimators", "WLS", "--json")
    found = json.loads(done.stdout)
    assert found["parts"] == ["identification", "validation"]
    (score,) = json.loads((identified.parent / "printed.json").read_text())["validation"]
    compared = sum(found["estimators"][0]["errors_percent"][1]) / len(found["joints"])
    # one behind the parallel filter, where samples that see a joint stick count as well, the other
    # behind a Butterworth of the same cut-off
    assert 0.5 < compared / score["mean_percent_moving"] < 2.0


@pytest.mark.slow
def test_a_single_log_is_divided(command) -> None:
    done = command("compare", ROBOT, LOG, "--json", "--estimators", *SOME)
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["left_out"] == "segment" and len(found["parts"]) == 5
    assert found["parts"][0].endswith(" s") and found["output"] is None
    assert {one["estimator"] for one in found["estimators"]} == set(SOME)
    sound = [one for one in found["estimators"] if not one["failures"]]
    assert sound, found["estimators"]
    for one in sound:
        assert 0.0 < one["mean_percent"] < 100.0 and one["standard_error_percent"] > 0.0
    assert found["recommended"]["name"] in {one["estimator"] for one in sound}


def test_an_estimator_that_fails_does_not_stop_the_others(command, monkeypatch) -> None:
    import numpy as np

    from steelyard.estimate import estimator_register as register
    from steelyard.estimate.estimator_register import Offer

    def failing(data: object) -> None:
        raise np.linalg.LinAlgError("Singular [matrix]")

    offers = (Offer("invented", "fails", lambda _: failing), *ESTIMATORS)
    monkeypatch.setattr(register, "ESTIMATORS", offers)
    done = command("compare", ROBOT, LOG, "--estimators", "invented", "WLS")
    assert done.exit_code == 0, done.output
    text = words(done.output)
    assert "invented failed (every fit): a matrix cannot be solved with (singular [matrix])" in text
    assert "Traceback" not in text and "Recommended: WLS" in text


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--estimators", "WSL"), ("no estimator 'WSL'", "--estimators", "did you mean 'WLS'")),
        (
            ("--estimators", "xyzzy"),
            ("no estimator 'xyzzy'", "the estimators are OLS, WLS", "CLOE, EKF"),
        ),
        (
            ("--estimators", "wls", "--all"),
            ("estimators are named, and all are requested", "leave out one of the two"),
        ),
        (("-o", "../given"), ("the output folder exists already",)),
    ],
)
def test_mistakes_are_reported(command, arguments, expected, work: Path) -> None:
    done = command("compare", ROBOT, LOG, *arguments)
    assert done.exit_code == 2 and done.stdout == ""
    for word in expected:
        assert word in done.stderr
    assert leftovers(work) == []


def test_a_log_is_not_left_out_of_itself(command) -> None:
    done = command("compare", ROBOT, LOG, LOG)
    assert done.exit_code == 2 and "is fitted twice" in done.stderr


def test_gains_are_to_be_known(command, given: Path, tmp_path: Path) -> None:
    amperes = 'kind = "motor_current"\nunit = "A"\ngain = "identify"'
    robot = edited(given, tmp_path, ('kind = "joint_torque"\nunit = "Nm"', amperes))
    done = command("compare", robot, LOG)
    assert done.exit_code == 2 and "every drive gain is to be identified" in done.stderr
    assert "write them into the robot file" in done.stderr


def test_logs_are_checked_before(command, given: Path, tmp_path: Path) -> None:
    done = command("compare", "../given/clock.toml", LOG)
    assert done.exit_code == 2 and "failed check" in done.stderr
    assert "--no-check continues anyway" in done.stderr


def test_names_are_taken_as_they_are_meant() -> None:
    offers = offers_of(("wls", "Bounded-LS", "WLS", "sdp"), everything=False)
    assert [offer.name for offer in offers] == ["WLS", "bounded LS", "SDP"]
    usual, every = offers_of((), everything=False), offers_of((), everything=True)
    assert every == ESTIMATORS and set(usual) == {o for o in ESTIMATORS if not o.slow}
    assert "IV" in {o.name for o in every} - {o.name for o in usual}


@pytest.mark.parametrize(
    ("section", "now"),
    [
        (EstimationSection(), "consistent"),
        (EstimationSection(method="least_squares"), "WLS"),
        (EstimationSection(method="least_squares", weights="equal"), "OLS"),
        (EstimationSection(method="BOUNDED_LS"), "bounded LS"),
    ],
)
def test_what_to_write_into_the_robot_file(section, now, given: Path) -> None:
    file = replace(load_robot(given / "demo_arm.toml"), estimation=section)
    assert method_of(file).name == now


@pytest.mark.slow
def test_the_robot_files_weights_count(command, given: Path, tmp_path: Path) -> None:
    equal = edited(given, tmp_path, ("[signals]", '[estimation]\nweights = "equal"\n\n[signals]'))
    means = {}
    for robot in (ROBOT, equal):
        done = command("compare", robot, LOG, OTHER, "--estimators", "consistent", "WLS", "--json")
        assert done.exit_code == 0, done.output
        found = {one["estimator"]: one for one in json.loads(done.stdout)["estimators"]}
        means[robot] = [found[name]["mean_percent"] for name in ("consistent", "WLS")]
    assert means[ROBOT][1] == pytest.approx(means[equal][1], rel=1e-9)
    assert means[ROBOT][0] != pytest.approx(means[equal][0], rel=1e-6)


@pytest.mark.slow
def test_the_advice_has_its_line(command) -> None:
    with results() as computed:
        done = command("compare", ROBOT, LOG, OTHER, "--estimators", "WLS", "OLS")
    text = words(done.output)
    assert "Recommended: WLS" in text and "two parts are few" in text
    assert 'in the robot file: [estimation] method = "WLS"' in text
    (found,) = computed
    assert found["robot_file"] == '[estimation] method = "WLS"'


COMPARE = ("compare", ROBOT, LOG, "--estimators", "WLS", "OLS", "--no-check")
SECOND = "weighted_robust_and_whitened.OrdinaryLeastSquares.__call__"


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_done(
    work: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(work)
    out = tmp_path / "out"
    code, _ = pressed_here(SECOND, (*COMPARE, "-o", str(out)), monkeypatch)
    shown = capsys.readouterr()
    assert (code, shown.err) == (130, "")
    assert "stopped: 1 of 2 estimators compared; not tried: OLS" in words(shown.out)
    found = json.loads((out / "compare.json").read_text())
    assert [one["estimator"] for one in found["estimators"]] == ["WLS"]
    assert found["stopped_before"] == ["OLS"]
    assert "stopped: 1 of 2" in (out / "compare.html").read_text()


@pytest.mark.slow
def test_ctrl_c_before_the_first_is_done_leaves_nothing(
    work: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(work)
    out = tmp_path / "out"
    code, _ = pressed_here("gather.gather", (*COMPARE, "-o", str(out)), monkeypatch)
    assert (code, *capsys.readouterr()) == (130, "", "stopped: nothing was written\n")
    assert not out.exists() and leftovers(work) == []
