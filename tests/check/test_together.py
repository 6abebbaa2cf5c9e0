"""Edits that were tried as one change are written together or not at all."""

from steelyard.check.finding import Edit, Finding, Fix, Severity
from steelyard.check.several_logs import OTHER_LOGS_AGREE, edits_that_serve_all_logs

ORDER, SIGN, UNIT = (("signals", key) for key in ("position", "position_sign", "time"))


def finding(name: str, log: str, path: tuple[str, ...] | None, jointly: bool = True) -> Finding:
    """Wrong, with an edit; ok without."""
    fix = None if path is None else Fix("Do.", (Edit(path, [1, 2]),), jointly)
    severity = Severity.OK if path is None else Severity.WRONG
    return Finding(name, log, severity, "says", "figure", fix=fix)


def edits(*found: Finding) -> dict[tuple[str, str], tuple[Edit, ...]]:
    return {
        (f.check, f.log): f.fix.edits for f in edits_that_serve_all_logs(found) if f.fix is not None
    }


def test_a_sign_does_not_outlive_the_order_that_it_was_found_with() -> None:
    order = (finding("order", "a", ORDER), finding("order", "b", None))
    sign = (finding("sign", "a", SIGN), finding("sign", "c", SIGN))
    unit = (finding("unit", "a", UNIT, jointly=False),)
    left = edits(*order, *sign, *unit)
    assert left["order", "a"] == left["sign", "a"] == ()
    assert left["sign", "c"] and left["unit", "a"]
    (sentence,) = (
        f.fix.says
        for f in edits_that_serve_all_logs((*order, *sign))
        if f.check == "sign" and f.log == "a" and f.fix is not None
    )
    assert sentence == f"Do.; {OTHER_LOGS_AGREE}"


def test_edits_of_one_log_that_no_other_contradicts_stay() -> None:
    assert all(edits(finding("order", "a", ORDER), finding("sign", "a", SIGN)).values())


def test_a_log_that_is_doubtful_itself_does_not_agree_with_the_robot_file() -> None:
    sign = (finding("sign", "a", SIGN), finding("sign", "b", None))
    other = Finding("unit", "b", Severity.DOUBTFUL, "says", "figure")
    first = edits_that_serve_all_logs((*sign, other))[0].fix
    assert first is not None and not first.edits and OTHER_LOGS_AGREE not in first.says
    assert "something else was found on them (b: unit)" in first.says
    third = finding("sign", "c", None)
    again = edits_that_serve_all_logs((*sign, other, third))[0].fix
    assert again is not None and OTHER_LOGS_AGREE in again.says


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
