"""What the checks found, in the terminal, in JSON, and as a page in a real browser."""

import io
import json

import pytest
from rich.console import Console

from report.conftest import EVIL, diagnosis
from steelyard.check.all_checks import Diagnosis
from steelyard.check.case_from_files_and_precheck import refusal
from steelyard.check.finding import ComparedHypothesis, Edit, Finding, Fix, Severity
from steelyard.check.findings_text_and_page import (
    CheckContent,
    by_edits,
    check_headline,
    diagnosis_dict,
    findings_of,
    groups,
    print_findings,
    print_notes,
    render_check,
    tally,
)
from steelyard.identify.page.gains_offsets_search_and_settings import CheckSection


def content(name: str = "arm", most: float = 1.0) -> CheckContent:
    said = diagnosis(name, most)
    return CheckContent(name, f"{name}.toml", (name, "b.csv"), name, said, {name: name}, (name,))


def printed(said: Diagnosis, width: int = 80, verbose: bool = True) -> str:
    console = Console(file=io.StringIO(), width=width)
    print_findings(said, console, verbose=verbose)
    return console.file.getvalue()


def many(severity: Severity, count: int) -> Diagnosis:
    says = "steps scatter"
    findings = [Finding("clock", f"run{k}", severity, says, f"{k} ms") for k in range(count)]
    return Diagnosis(tuple(findings))


def test_the_worst_is_last_and_the_verdict_at_the_end() -> None:
    lines = printed(diagnosis("arm")).splitlines()
    starts = [line.split()[0] for line in lines if line[:1].isalpha()]
    assert starts == ["ok", "ok", "doubtful", "wrong", "fix", "Wrong:"]
    assert lines[-1] == "Wrong: unit arm  (4 checks: 1 wrong, 1 doubtful, 2 ok)"
    at = next(k for k, line in enumerate(lines) if line.startswith("fix unit arm: say so arm"))
    assert [line.rstrip() for line in lines[at + 1 : at + 3]] == [
        "    [signals.effort]",
        '    unit = "mAarm"',
    ]


def test_checks_that_are_ok_are_one_line() -> None:
    said = Diagnosis((*many(Severity.OK, 2).findings, *diagnosis("arm").findings))
    lines = printed(said, verbose=False).splitlines()
    assert [line for line in lines if line.startswith("ok")] == [lines[0]]
    names = dict.fromkeys(f.check for f in said.findings if not f.severity)
    assert lines[0].split() == ["ok", str(len(names)), "checks", *", ".join(names).split()]
    assert lines[2].startswith("doubtful") and lines[-1].startswith("Wrong")


def test_an_ok_check_with_a_brief_finding_has_a_line() -> None:
    ok, says = Severity.OK, "8 corrupt rows (the first is row 3, the last 90), dropped"
    fine = Finding("rows", "a", ok, "no corrupt rows", "0 of 100 rows")
    dropped = Finding("rows", "b", ok, says, "8 of 100 rows", brief="8 corrupt rows dropped")
    lines = printed(Diagnosis((dropped,)), verbose=False).splitlines()
    assert lines[0].split(maxsplit=2) == ["ok", "rows", "8 corrupt rows dropped"]
    both = Diagnosis((*many(ok, 1).findings, fine, dropped))
    first, second, *_ = printed(both, verbose=False).splitlines()
    assert first.split() == ["ok", "1", "check", "clock"]
    assert second.split(maxsplit=2) == ["ok", "rows", "b: 8 corrupt rows dropped"]
    assert says in " ".join(printed(Diagnosis((dropped,))).split())


@pytest.mark.parametrize("width", [80, 120])
def test_rows_fit_the_terminal(width: int) -> None:
    long = " ".join(["much"] * 60)
    said = Diagnosis((Finding("velocity lag", "run", Severity.WRONG, long, long, ("elbow",)),))
    text = printed(said, width)
    assert max(map(len, text.splitlines())) <= width
    assert text.count("much") == 120


@pytest.mark.parametrize(
    ("says", "before"),
    [
        ("efforts of joint_1 and joint_2 are reversed", "run: "),
        ("efforts of joint_1 and joint_20 are reversed", "run: joint_1, joint_2: "),
        ("efforts are reversed", "run: joint_1, joint_2: "),
    ],
)
def test_joints_that_the_sentence_names_are_not_named_before_it(says: str, before: str) -> None:
    finding = Finding("effort sign", "run", Severity.WRONG, says, "3 σ", ("joint_1", "joint_2"))
    assert print_notes(Diagnosis((finding,))) == (f"check, effort sign: {before}{says} (3 σ)",)


def test_what_is_ok_may_be_left_out() -> None:
    console = Console(file=io.StringIO(), width=80)
    print_findings(many(Severity.OK, 2), console, fine=False)
    assert console.file.getvalue() == "Ok: no error was found\n"


def test_many_logs_that_are_ok_are_one_row() -> None:
    text = printed(many(Severity.OK, 18))
    assert "clock  18 logs: steps scatter" in text and "run3" not in text
    assert "clock  steps scatter" in printed(many(Severity.OK, 1))


def test_of_logs_that_are_ok_in_different_ways_the_first_is_quoted() -> None:
    findings = [Finding("clock", f"run{k}", Severity.OK, f"{k} Hz", "") for k in (125, 126)]
    whole = Finding("clock", "", Severity.OK, "125 Hz", "")
    (line,) = printed(Diagnosis(tuple(findings))).splitlines()[:1]
    assert line.split()[2:] == "2 logs; the first, run125: 125 Hz".split()
    (line,) = printed(Diagnosis((*findings, whole))).splitlines()[:1]
    assert line.split()[2:] == "2 logs and all logs together; the first, run125: 125 Hz".split()


def test_of_many_that_are_not_some_are_told_and_the_others_named() -> None:
    text = printed(many(Severity.DOUBTFUL, 9))
    assert text.count("steps scatter") == 3 and "run2: steps scatter" in text
    assert "and 6 more: run3, run4, run5, run6 and 2 others" in text
    assert print_notes(many(Severity.DOUBTFUL, 2)) == (
        "check, clock: run0: steps scatter (0 ms); and 1 more: run1",
    )
    assert print_notes(many(Severity.OK, 2)) == ()


def test_words_of_the_verdict() -> None:
    assert check_headline(many(Severity.OK, 2)) == "Ok: no error was found"
    assert check_headline(many(Severity.DOUBTFUL, 2)) == "Doubtful: clock"
    assert (check_headline(Diagnosis(())), tally(Diagnosis(()))) == (
        "No check applies",
        "no findings",
    )
    assert [group[0].severity for group in groups(diagnosis())] == [0, 0, 1, 2]


def opened(checks: str, hidden: bool = True) -> Diagnosis:
    """Checks that are open, because of a misfit or for other reasons, beside one that is ok."""
    findings = [
        Finding(name, "run", Severity.OK, "?", "", answered=False, hidden=hidden)
        for name in checks.split(", ")
    ]
    return Diagnosis((*findings, *many(Severity.OK, 1).findings))


BASIC = "joint order, effort unit, mounting"


@pytest.mark.parametrize(
    ("checks", "hidden", "words"),
    [
        (
            BASIC,
            True,
            "Inconclusive: 3 of 4 checks could not be decided; the robot file may be wrong",
        ),
        (f"{BASIC}, gain", True, "Inconclusive: 4 of 5 checks could not be decided; "),
        (BASIC, False, f"Ok, but 3 of 4 checks could not be decided: {BASIC}"),
        ("gain, joint zeros, payload", True, "Ok, but 3 of 4 checks could not be decided: gain"),
        (
            "transmission, gain, payload",
            False,
            "Open: the logs do not decide transmission, gain, payload (3 of 4 checks); no error "
            "was found",
        ),
    ],
)
def test_basic_questions_that_a_misfit_leaves_open_are_doubtful(
    checks: str, hidden: bool, words: str
) -> None:
    said = opened(checks, hidden)
    assert check_headline(said).startswith(words)
    assert said.inconclusive == words.startswith("Inconclusive")
    assert said.severity == (Severity.DOUBTFUL if said.inconclusive else Severity.OK)
    assert words.split(":")[0] in printed(said) and not said.edits
    assert diagnosis_dict(said)["severity"] == said.severity.word


def test_a_check_counts_once_with_the_worst_that_it_found() -> None:
    clock = [Finding("clock", f"run{k}", Severity.OK, "steady", "") for k in range(3)]
    gain = Finding("gain", "run1", Severity.OK, "?", "", answered=False)
    fine = Finding("gain", "run2", Severity.OK, "right", "")
    said = Diagnosis((*clock, fine, gain))
    assert tally(said) == "2 checks: 1 open, 1 ok"
    assert check_headline(said) == "Ok, but 1 of 2 checks could not be decided: gain"
    short = printed(said, verbose=False)
    assert short.startswith("ok    1 check  clock") and "right" not in short
    assert "right" in printed(said) and "3 logs: steady" in printed(said)
    assert "1 doubtful" in tally(Diagnosis((*said.findings, *many(Severity.DOUBTFUL, 2).findings)))


def test_a_finding_comes_before_open_questions() -> None:
    wrong = Diagnosis((*opened(BASIC).findings, *many(Severity.WRONG, 1).findings))
    assert not wrong.inconclusive and check_headline(wrong) == "Wrong: clock"


def test_json_has_stable_keys_and_no_infinity() -> None:
    told = json.loads(json.dumps(diagnosis_dict(diagnosis()), allow_nan=False))
    assert list(told) == ["severity", "findings", "edits"]
    assert told["severity"] == "wrong"
    assert told["edits"] == [{"path": ["signals", "effort", "unit"], "value": "mAarm"}]
    wrong = told["findings"][1]
    assert wrong == {
        "check": "unit arm",
        "log": "arm",
        "severity": "wrong",
        "says": "a thousand times too much arm",
        "figure": "9000 A arm",
        "answered": True,
        "joints": ["arm"],
        "fix": {
            "says": "say so arm",
            "edits": told["edits"],
            "lines": '[signals.effort]\nunit = "mAarm"',
        },
        "hypotheses": [
            {"says": "in mA arm", "misfit_percent": 4.3, "log_likelihood": 0.0},
            {"says": "arm", "misfit_percent": None, "log_likelihood": -1.0},
        ],
    }


def drawn(dom: str) -> int:
    """Pictures with something in them."""
    pieces = dom.split('class="picture js-plotly-plot"')[1:]
    return sum("main-svg" in piece and "trace" in piece for piece in pieces)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["arm", EVIL])
def test_the_browser_draws_the_page_without_an_error(name: str, browse) -> None:
    seen = browse(render_check(content(name)))
    assert seen.console == () and seen.errors == []
    for section in ("verdict", "fixes", "evidence"):
        assert f'<section id="{section}"' in seen.dom
    assert drawn(seen.dom) == 1
    assert seen.dom.index("1 doubtful") < seen.dom.index("a thousand times")


def test_what_is_ok_is_drawn_once_it_is_opened(browse) -> None:
    opened = "document.querySelectorAll('details').forEach((one) => { one.open = true; });"
    seen = browse(render_check(content()), opened)
    assert seen.console == () and drawn(seen.dom) == 3


def test_the_page_asks_no_network_and_keeps_strangers_names_as_text() -> None:
    page = render_check(content(EVIL))
    start = page.index("<script>", page.index("</main>"))
    own = page[:start]
    assert "http:" not in own and "https:" not in own and "default-src 'none'" in own
    assert "<script>document.body" not in own and "{{7*7}}" in own
    assert "checked with steelyard" in page


def test_numbers_that_are_none_break_no_page(browse) -> None:
    seen = browse(render_check(content("arm", float("nan"))))
    assert seen.console == () and seen.errors == []


def test_pictures_stay_within_a_budget() -> None:
    numbers = findings_of(diagnosis())
    assert [one["picture"] is not None for one in numbers["bad"]] == [True, False]
    assert all(one["picture"] is not None for one in numbers["fine"])
    few = findings_of(diagnosis(), 7000)
    assert few["bad"][0]["picture"] is not None
    assert all(one["picture"] is None for one in few["fine"])


def of_payload(nominal: bool, *rivals: ComparedHypothesis) -> Finding:
    return Finding("payload", "run", Severity.OK, "", "", hypotheses=rivals, nominal=nominal)


def test_it_is_said_why_a_finding_is_ok_though_a_rival_fits_better() -> None:
    load, declared = (
        ComparedHypothesis("0.9 kg", 4.1, 0.0),
        ComparedHypothesis("as declared", 7.8, -257.0, declared=True),
    )
    nominal = of_payload(True, load, declared)
    known = of_payload(False, load, declared)
    best = of_payload(True, declared, load)
    wrong = Finding("gain", "run", Severity.WRONG, "", "", hypotheses=(load, declared))

    def still(*findings: Finding) -> list[str]:
        return [one["still"] for one in findings_of(Diagnosis(findings))["fine"]]

    assert still(best) == [""] and still(nominal, wrong) == [""]
    said, reference = still(nominal, known)
    assert "misfit as declared is 7.8\u00a0%" in said and "errors of the nominal masses" in said
    assert "nominal" not in reference and "gain is statistically significant" in reference
    content_of = CheckContent("r", "r.toml", ("run",), None, Diagnosis((nominal,)), {}, ())
    page = render_check(content_of)
    assert "Ok although another hypothesis fits better" in page
    explained = "Log-likelihoods are relative to the most likely hypothesis"
    assert page.count(explained) == 1 and explained not in CheckSection().show(
        findings_of(many(Severity.OK, 2))
    )


def test_open_questions_stand_on_the_page_before_what_is_ok() -> None:
    left = Finding("gain", "run", Severity.OK, "cannot be told", "", answered=False)
    fine = Finding("clock", "run", Severity.OK, "200 Hz", "")
    said = Diagnosis((fine, left))
    page = render_check(CheckContent("r", "r.toml", ("run",), None, said, {}, ()))
    assert page.index("cannot be told") < page.index("200 Hz")
    assert '<span class="tag open">open</span>' in page


def test_ok_findings_are_folded_by_suspicion() -> None:
    html = CheckSection().show(findings_of(many(Severity.OK, 18)))
    assert html.count("<details") == 2 and "<details open" not in html
    assert "18 findings, the first: steps scatter" in html and html.count("<h3>") == 18


def test_the_report_shows_the_check_if_there_was_one(usual) -> None:
    numbers = CheckSection().numbers(usual)
    assert numbers is not None and all(one["picture"] is None for one in numbers["fine"])
    assert "Wrong: unit arm" in CheckSection().show(numbers)


def test_logs_that_need_the_same_lines_are_stated_once() -> None:
    def finding(log: str, unit: str) -> Finding:
        fix = Fix(f"they are in {unit}", (Edit(("signals", "position_unit"), unit),))
        return Finding("position", log, Severity.WRONG, f"{log} in {unit}", f"5 of {log}", fix=fix)

    wrong = (finding("a", "deg"), finding("b", "deg"), finding("c", "mm"))
    assert [[f.log for f in alike] for alike in by_edits(wrong)] == [["a", "b"], ["c"]]
    bare = (
        Finding("rows", "a", Severity.WRONG, "x", ""),
        Finding("rows", "b", Severity.WRONG, "x", ""),
    )
    assert len(by_edits(bare)) == 2
    error = refusal(Diagnosis(wrong), "arm.toml")
    assert (
        error is not None and "a in deg; c in mm" in error.wrong and "b in deg" not in error.wrong
    )
    assert "5 of a" in error.where and "5 of b" in error.where
    text = printed(Diagnosis(wrong))
    assert "the same in b (5 of b)" in text and "b in deg" not in text
