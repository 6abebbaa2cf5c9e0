"""What the check before the fit leaves open stands in the headline of what follows."""

from steelyard.check.all_checks import Diagnosis
from steelyard.check.finding import Finding, Severity
from steelyard.identify.identify import _open_questions


def left_open(check: str, says: str) -> Finding:
    return Finding.ok(says, answered=False).by(check)


def test_open_questions_are_named_and_up_to_two_explained() -> None:
    kind = left_open("effort kind", "undecided: links fit 2 times as heavy")
    unit = left_open("effort unit", "undecided until 'effort kind' is decided")
    payload = left_open("payload", "undecided: it may carry something")
    fine = Finding.ok("right").by("mounting")
    assert _open_questions(Diagnosis((fine, payload))) == ()
    (found,) = _open_questions(Diagnosis((kind, unit, payload, fine)))
    assert found.headline and found.severity is Severity.OK
    assert found.brief.endswith("effort kind (links fit 2 times as heavy)")
    others = [left_open(name, "undecided: other") for name in ("mounting", "joint order")]
    (found,) = _open_questions(Diagnosis((kind, *others)))
    assert found.brief.endswith(": effort kind, mounting, joint order")
    assert "mounting (other)" in found.says
