"""Edits are written if every log asks for them; those that were tried as one change go together."""

import pytest

from steelyard.check.all_checks import MOTION_CHECKS_NAME, edits_that_serve_all_logs
from steelyard.check.finding import Edit, Finding, Fix, Severity

ORDER, SIGN, UNIT = (("signals", key) for key in ("position", "position_sign", "time"))


def finding(
    name: str, log: str, path: tuple[str, ...] | None, value: object = (1, 2), jointly: bool = True
) -> Finding:
    """Wrong, with an edit; ok without."""
    fix = None if path is None else Fix("Do.", (Edit(path, value),), jointly)
    severity = Severity.OK if path is None else Severity.WRONG
    return Finding(name, log, severity, "says", "figure", fix=fix)


def edits(*found: Finding) -> dict[tuple[str, str], tuple[Edit, ...]]:
    return {
        (f.check, f.log): f.fix.edits for f in edits_that_serve_all_logs(found) if f.fix is not None
    }


def test_a_sign_does_not_outlive_the_order_that_it_was_found_with() -> None:
    order = (finding("order", "a", ORDER), finding("order", "b", None))
    sign = (finding("sign", "a", SIGN), finding("sign", "b", SIGN))
    unit = [finding("unit", log, UNIT, jointly=False) for log in "ab"]
    left = edits(*order, *sign, *unit)
    assert left["order", "a"] == left["sign", "a"] == left["sign", "b"] == ()
    assert left["unit", "a"] and left["unit", "b"]
    sentences = {
        f.fix.says for f in edits_that_serve_all_logs((*order, *sign)) if f.fix is not None
    }
    (sentence,) = sentences
    assert sentence.startswith("Do.; b does not require another signals.position: ")
    assert "give a a robot file of its own" in sentence


def test_a_log_whose_motion_is_not_tested_is_not_said_to_need_nothing() -> None:
    """Its positions are wrong; with the right ones it may ask for the same."""
    untested = Finding(MOTION_CHECKS_NAME, "b", Severity.OK, "positions first", answered=False)
    found = (
        finding("mounting", "a", ("robot", "gravity")),
        finding("position", "b", UNIT),
        untested,
    )
    says = {f.log: f.fix.says for f in edits_that_serve_all_logs(found) if f.fix is not None}
    assert says["a"].startswith("Do.; b cannot be tested for robot.gravity before what is wrong")
    assert "a does not require another signals.time" in says["b"]
    assert says["b"].endswith("give b a robot file of its own, or convert its columns")


def test_edits_of_a_single_log_stay() -> None:
    assert all(edits(finding("order", "a", ORDER), finding("sign", "a", SIGN)).values())


@pytest.mark.parametrize("other", ["open", "doubtful", "another check"])
def test_a_log_that_does_not_ask_for_an_edit_does_not_support_it(other: str) -> None:
    says = {
        "open": Finding("sign", "b", Severity.OK, "says", answered=False),
        "doubtful": Finding("sign", "b", Severity.DOUBTFUL, "says"),
        "another check": finding("unit", "b", UNIT),
    }
    assert not any(edits(finding("sign", "a", SIGN), says[other]).values())


def test_one_line_may_be_asked_for_by_several_checks() -> None:
    gain = ("signals", "effort", "gain")
    asked = (finding("sign", "a", gain, [-1.0, 1.0]), finding("gain", "b", gain, [-1.0, 1.0]))
    assert all(edits(*asked).values())
    for found in edits_that_serve_all_logs((*asked, finding("sign", "c", gain, [1.0, 1.0]))):
        assert found.fix is not None and not found.fix.edits
        assert found.severity == Severity.DOUBTFUL
        assert "gain: [-1.0, 1.0] (a), [-1.0, 1.0] (b), [1.0, 1.0] (c)" in found.fix.says


RATIOS = ("robot", "transmission", "ratios")


def ratio(log: str, value: float, spread: float) -> Finding:
    fix = Fix("Do.", (Edit(RATIOS, [100.0, value], spread),))
    return Finding("gain", log, Severity.WRONG, f"ratio {value}", "figure", fix=fix)


def test_factors_that_differ_by_more_than_their_accuracy_are_not_written() -> None:
    runs = [ratio(log, x, 0.02) for log, x in (("a", 307.0), ("b", 384.0), ("c", 531.0))]
    for found in edits_that_serve_all_logs(runs):
        assert found.severity == Severity.DOUBTFUL and found.fix is not None
        assert not found.fix.edits
        assert all(text in found.fix.says for text in ("307.0", "384.0", "531.0", "± 4 % (b)"))


def test_factors_within_their_accuracy_become_their_median() -> None:
    runs = [ratio(log, x, 0.02) for log, x in (("a", 307.0), ("b", 312.0), ("c", 300.0))]
    assert {tuple(f.fix.edits[0].value) for f in edits_that_serve_all_logs(runs) if f.fix} == {
        (100.0, 307.0)
    }
    rough = [ratio(log, x, 0.1) for log, x in (("a", 307.0), ("b", 384.0))]
    assert all(f.severity == Severity.WRONG for f in edits_that_serve_all_logs(rough))
