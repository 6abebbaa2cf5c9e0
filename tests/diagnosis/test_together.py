"""Edits that were tried as one change are written together or not at all."""

from steelyard.diagnosis import Edit, Finding, Judgement, Mend
from steelyard.diagnosis.together import APART, together

ORDER, SIGN, UNIT = (("signals", key) for key in ("position", "position_sign", "time"))


def finding(name: str, log: str, path: tuple[str, ...] | None, jointly: bool = True) -> Finding:
    """Wrong, with an edit; ok without."""
    mend = None if path is None else Mend("Do.", (Edit(path, [1, 2]),), jointly)
    judgement = Judgement.OK if path is None else Judgement.WRONG
    return Finding(name, log, judgement, "says", "figure", mend=mend)


def edits(*found: Finding) -> dict[tuple[str, str], tuple[Edit, ...]]:
    return {(f.suspicion, f.log): f.mend.edits for f in together(found) if f.mend is not None}


def test_a_sign_does_not_outlive_the_order_that_it_was_found_with() -> None:
    order = (finding("order", "a", ORDER), finding("order", "b", None))
    sign = (finding("sign", "a", SIGN), finding("sign", "c", SIGN))
    unit = (finding("unit", "a", UNIT, jointly=False),)
    left = edits(*order, *sign, *unit)
    assert left["order", "a"] == left["sign", "a"] == ()
    assert left["sign", "c"] and left["unit", "a"]
    (said,) = (
        f.mend.says
        for f in together((*order, *sign))
        if f.suspicion == "sign" and f.log == "a" and f.mend is not None
    )
    assert said == f"Do.; {APART}"


def test_edits_of_one_log_that_no_other_contradicts_stay() -> None:
    assert all(edits(finding("order", "a", ORDER), finding("sign", "a", SIGN)).values())


def test_a_log_that_is_doubtful_itself_does_not_agree_with_the_robot_file() -> None:
    sign = (finding("sign", "a", SIGN), finding("sign", "b", None))
    doubt = Finding("unit", "b", Judgement.DOUBTFUL, "says", "figure")
    first = together((*sign, doubt))[0].mend
    assert first is not None and not first.edits and APART not in first.says
    assert "something else was found on them (b: unit)" in first.says
    third = finding("sign", "c", None)
    again = together((*sign, doubt, third))[0].mend
    assert again is not None and APART in again.says


RATIOS = ("robot", "transmission", "ratios")


def ratio(log: str, value: float, spread: float) -> Finding:
    mend = Mend("Do.", (Edit(RATIOS, [100.0, value], spread),))
    return Finding("gain", log, Judgement.WRONG, f"ratio {value}", "figure", mend=mend)


def test_factors_that_differ_by_more_than_their_accuracy_are_not_written() -> None:
    runs = [ratio(log, x, 0.02) for log, x in (("a", 307.0), ("b", 384.0), ("c", 531.0))]
    for found in together(runs):
        assert found.judgement == Judgement.DOUBTFUL and found.mend is not None
        assert not found.mend.edits
        assert all(text in found.mend.says for text in ("307.0", "384.0", "531.0", "± 4 % (b)"))


def test_factors_within_their_accuracy_become_their_median() -> None:
    runs = [ratio(log, x, 0.02) for log, x in (("a", 307.0), ("b", 312.0), ("c", 300.0))]
    assert {tuple(f.mend.edits[0].value) for f in together(runs) if f.mend} == {(100.0, 307.0)}
    rough = [ratio(log, x, 0.1) for log, x in (("a", 307.0), ("b", 384.0))]
    assert all(f.judgement == Judgement.WRONG for f in together(rough))
