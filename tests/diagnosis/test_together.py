"""Edits that were tried as one change are written together or not at all."""

from steelyard.diagnosis import Edit, Finding, Judgement, Mend
from steelyard.diagnosis.together import APART, together, whole

ORDER, SIGN, UNIT = (("signals", key) for key in ("position", "position_sign", "time"))


def finding(name: str, log: str, path: tuple[str, ...] | None, jointly: bool = True) -> Finding:
    """Wrong, with an edit; ok without."""
    mend = None if path is None else Mend("Do.", (Edit(path, [1, 2]),), jointly)
    judgement = Judgement.OK if path is None else Judgement.WRONG
    return Finding(name, log, judgement, "says", "figure", mend=mend)


def edits(*found: Finding) -> dict[tuple[str, str], tuple[Edit, ...]]:
    return {(f.suspicion, f.log): f.mend.edits for f in whole(found) if f.mend is not None}


def test_a_sign_does_not_outlive_the_order_that_it_was_found_with() -> None:
    order = together((finding("order", "a", ORDER), finding("order", "b", None)))
    sign = together((finding("sign", "a", SIGN), finding("sign", "c", SIGN)))
    unit = together((finding("unit", "a", UNIT, jointly=False),))
    left = edits(*order, *sign, *unit)
    assert left["order", "a"] == left["sign", "a"] == ()
    assert left["sign", "c"] and left["unit", "a"]
    (said,) = (
        f.mend.says
        for f in whole((*order, *sign))
        if f.suspicion == "sign" and f.log == "a" and f.mend is not None
    )
    assert said == f"Do.; {APART}"


def test_edits_of_one_log_that_no_other_contradicts_stay() -> None:
    found = (*together((finding("order", "a", ORDER),)), *together((finding("sign", "a", SIGN),)))
    assert all(edits(*found).values())
