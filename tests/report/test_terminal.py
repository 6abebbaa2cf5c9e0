import csv
import io
import re
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from report.inspected import contact_content, payload_events
from steelyard.check.finding import Finding, Severity
from steelyard.estimate.estimate import KnownScales
from steelyard.estimate.scores.effort_errors import pooled
from steelyard.identify.page.report_content_and_error_words import ReportContent, coverage_words
from steelyard.identify.scores_and_model_report import (
    CSV_COLUMNS,
    parameters_csv,
    print_report,
    render,
)
from steelyard.identify.verdict_and_next_steps import verdict
from steelyard.uses.payload.payload import PayloadsOfLogs
from steelyard.uses.watch.watch import summary_lines


def printed(content: ReportContent, width: int = 120, verbose: bool = False) -> str:
    console = Console(file=io.StringIO(), width=width)
    print_report(content, console, verbose)
    return console.file.getvalue()


def row(text: str, name: str) -> list[str]:
    """Cells of the first row of a table without lines."""
    line = next(line for line in text.splitlines() if line.startswith(name))
    return re.split(r" {2,}", line.strip())


def test_the_summary_says_what_matters(usual):
    one = replace(usual, scores=usual.scores[:1])
    text = printed(one)
    assert text.startswith("GOOD: Predicts") and verdict(one).to_dict()["level"] == "good"
    assert "Predicts unseen motion with an error of 1.3 Nm" in text
    assert "points, not fitted (RMS below 5 Hz, where each joint moves)" in text
    assert "run1" not in text
    assert row(text, "joint") == ["joint", "error", "of used", "of limit", "used", "limit", "over"]
    assert row(text, "elbow") == [
        "elbow",
        "1.50 Nm",
        "5.0\u00a0%",
        "3.0\u00a0%",
        "30.0",
        "50.0",
        "30.0 s",
    ]
    assert row(text, "pooled") == ["pooled", "1.27 Nm", "5.0\u00a0%", "2.5\u00a0%"]
    assert "13 base parameters: 9 identified, 1 small effect, 1 poorly identified, 1 from" in text
    assert "note: velocity: from positions" in text
    for detail in ("condition number", "offset.elbow", "below 8 Hz", "95 % bands", "Hampel"):
        assert detail not in text


def test_a_level_that_remarks_lower_says_so(usual):
    plain = verdict(replace(usual, limitations=()))
    doubt = Finding("residuals", "", Severity.DOUBTFUL, "residuals", "")
    limited = verdict(replace(usual, limitations=(doubt,)))
    assert (plain.level, limited.level) == ("good", "fair")
    assert limited.detail.endswith("GOOD by this error, FAIR because of what checks found.")
    assert "because of what checks found" not in plain.detail


def test_scales_of_the_efforts_stand_under_the_table(usual):
    line = "efforts divided by the estimated scale: shoulder 0.90, elbow 1.10"
    assert "estimated scale" not in printed(usual) + render(usual)
    known = KnownScales(("shoulder", "elbow"), np.array([0.9, 1.1]), 1e-4 * np.eye(2))
    scaled = replace(usual, identified=replace(usual.identified, effort_scales=known))
    for content in (
        scaled,
        replace(scaled, scores=scaled.scores[:1]),
        replace(scaled, scores=(), only_errors=True),
    ):
        assert line in printed(content)
        assert line[1:] in render(content)


def test_the_error_against_efforts_as_logged_is_printed_and_judged(usual):
    def scaled(score, factor):
        joints = tuple(replace(x, error=factor * x.error) for x in score.errors.joints)
        return replace(score, errors=replace(score.errors, as_logged=joints))

    score = usual.scores[0]
    (error,) = pooled([score.errors])
    for factor, level in ((0.5, "good"), (4.0, "fair"), (9.0, "fair")):
        content = replace(usual, scores=(scaled(score, factor),), limitations=())
        judged = verdict(content)
        assert judged.level == level
        largest = max(1.0, factor) * error.percent_of_used
        assert judged.percent_of_used == pytest.approx(largest)
        text = printed(content)
        words = "of the effort used, as logged"
        assert f"{words} {factor * error.error:.2g} Nm: " in " ".join(text.split())
        table = text[text.index("not fitted (") :]
        assert row(table, "joint")[3] == "as logged"
        share = error.percent_of_used * factor
        assert float(row(table, "pooled")[3].rstrip("\u00a0%")) == pytest.approx(share, abs=0.051)
        assert '<th scope="col">As logged</th>' in render(content)
    poor = verdict(replace(usual, scores=(scaled(score, 9.0),)))
    assert poor.headline.endswith("(shoulder 45.0\u00a0% as logged, elbow 45.0\u00a0% as logged)")
    assert render(replace(usual, scores=(scaled(score, 9.0),))).count('"hint poor">poor') == 2
    several = printed(replace(usual, scores=(scaled(score, 4.0), scaled(score, 4.0))))
    assert row(several, "run  ")[3] == "as logged"
    assert "as logged" not in printed(usual) + render(usual)


def test_the_details_are_printed_on_request(usual):
    content = replace(usual, scores=usual.scores[:1], details=("Hampel threshold 15",))
    text = printed(content, verbose=True)
    assert text.startswith(printed(content).partition("note:")[0])
    assert "points, in the validation band, below 8 Hz" in text
    assert "9.0\u00a0% over all joints together, whole log" in text and "95 % bands" in text
    line = text.partition("in the validation band, below")[2]
    assert row(line, "elbow") == [
        "elbow",
        "10.0\u00a0%",
        "12.5\u00a0%",
        "0.200",
        "0.150",
        "3.00",
        "2.00",
        "A",
    ]
    assert "13 base parameters, normalised condition number 41.5" in text
    assert "1 small effect: Iyy.link of shoulder" in text
    assert "1 poorly identified: mz.link of shoulder" in text
    assert "1 not identifiable: offset.elbow" in text
    assert "note: Hampel threshold 15" in text


def test_names_of_joints_are_whole_at_80_columns(usual):
    name = "shoulder_pan_joint"
    score = usual.scores[0]
    joints = tuple(replace(joint, joint=name) for joint in score.joints)
    content = replace(usual, scores=(replace(score, joints=joints),))
    table = printed(content, 80, verbose=True).partition("in the validation band, below")[2]
    assert len(row(table, name)) == 8


def test_numbers_are_whole_beside_long_names(usual):
    name = "AR5-5_07R-W4C4A2_joint_1"
    score = usual.scores[0]
    joints = tuple(replace(joint, joint=name, rmse=0.09671) for joint in score.joints)
    content = replace(usual, scores=(replace(score, joints=joints),))
    table = printed(content, 80, verbose=True).partition("in the validation band, below")[2]
    first, *rest = row(table, "AR5-5")
    assert name.startswith(first) and first != name and "0.0967" in rest


def test_several_runs_have_one_row_each(usual):
    text = printed(usual)
    assert (
        "2 runs, not fitted (RMS below 5 Hz, pooled over 2 joints, where they move, 60 s each)"
        in text
    )
    assert row(text, "circle") == [
        "circle",
        "2.04 Nm",
        "8.0\u00a0%",
        "4.1\u00a0%",
        "elbow 8.0\u00a0%",
    ]
    assert not any(line.startswith("elbow") for line in text.splitlines())
    assert "\nelbow" in printed(usual, verbose=True)


def test_a_joint_at_rest_is_said_not_to_count(usual):
    score = usual.scores[0]
    joints = (score.errors.joints[0], replace(score.errors.joints[1], counted=False))
    resting = replace(score, errors=replace(score.errors, joints=joints))
    text = printed(replace(usual, scores=(resting,)))
    assert row(text, "elbow")[-1] == "at rest"
    assert row(text, "pooled")[1] == "1.00 Nm"


def test_unseen_runs_alone_make_the_headline_where_others_repeat_a_motion(usual):
    again = replace(usual.scores[0], run="again", repeats="run1")
    both = printed(replace(usual, scores=(*usual.scores, again)))
    assert "Predicts unseen motion with an error of 1.7 Nm: 6.7" in both
    assert "again (repeats run1)" in both
    alone = replace(usual, scores=(again,))
    assert printed(alone).startswith("Predicts repeated motion with an error of")
    assert "again, not fitted, repeats the motion of run1 (RMS below 5 Hz" in printed(alone)
    assert verdict(alone).level == "none" and verdict(usual).level == "good"


def test_names_are_no_markup_and_numbers_may_be_none(nasty):
    text = printed(nasty, 400)
    assert "Not validated on unseen motion" in text and "8 runs, fitted (RMS" in text
    assert "<script>" in text
    bracket = replace(nasty, notes=("[bold]not bold[/bold]",))
    assert "note: [bold]not bold[/bold]" in printed(bracket)


def test_the_csv_holds_every_base_parameter_exactly(usual):
    table = list(csv.DictReader(io.StringIO(parameters_csv(usual.identified))))
    estimate = usual.identified.estimate
    assert tuple(table[0]) == CSV_COLUMNS
    assert len(table) == len(usual.identified.base)
    seen = [row for row in table if row["value"]]
    assert [float(row["value"]) for row in seen] == estimate.parameters.values.tolist()
    assert [float(row["std"]) for row in seen] == estimate.std.tolist()
    assert table[0]["group"] == "mx.link of shoulder + 0.4 m.link of elbow"
    assert table[0]["unit"] == "kg m" and table[0]["status"] == "identified"
    last = table[-1]
    assert (last["status"], last["remark"]) == ("not identifiable", "tied to mx.link of shoulder")
    assert [last[c] for c in ("value", "std", "lower95", "upper95", "relative_std_percent")] == (
        [""] * 5
    )


def test_the_csv_of_broken_numbers_has_empty_cells(nasty):
    table = list(csv.DictReader(io.StringIO(parameters_csv(nasty.identified))))
    assert table[0]["std"] == "" and table[0]["value"] != ""
    assert "nan" not in parameters_csv(nasty.identified).lower()
    assert "inf" not in parameters_csv(nasty.identified).lower()


def test_bands_that_hold_less_than_they_promise_are_named():
    assert coverage_words(85.0, True) == "85.0\u00a0% of this log inside: less than stated"
    assert "less" not in coverage_words(92.0, True) + coverage_words(85.0, False)


def test_no_change_of_payload_is_claimed_only_where_one_would_be_seen():
    clear = replace(payload_events(), run="day", events=(), carried=(), notes=(), least_mass=0.451)
    blind = replace(clear, least_mass=4.34, conclusive=False)
    lines = []
    for found in (clear, blind):
        console = Console(file=io.StringIO(), width=200)
        PayloadsOfLogs("arm", (found,)).show(console)
        lines.append(console.file.getvalue())
    assert lines[0] == "day: no change of payload by 0.45 kg or more\n"
    assert "day: cannot tell whether the payload changes: one by less than 4.3 kg" in lines[1]
    assert "no change" not in lines[1]


def test_a_standing_robot_is_named_with_the_pushes_that_are_visible():
    moving = replace(contact_content(), events=())
    still = np.full_like(moving.trace.fastest, 1e-6)
    resting = replace(moving, trace=replace(moving.trace, fastest=still, slowest=still))
    assert moving.headline == "No contact in 20.0 s of shift"
    assert resting.headline == "No contact in 20.0 s of shift, in which the robot stands"
    words = "at rest only pushes above these thresholds are visible: "
    visible = "shoulder_lift_joint 9.0 Nm, a_joint_with_a_name_that_is_rather_long 12 N"
    assert any(warning.endswith(f"{words}{visible}") for warning in resting.warnings)
    assert not any("no joint moves" in warning for warning in moving.warnings)


def test_signs_in_the_table_of_thresholds_are_explained():
    content = contact_content()
    thresholds = content.thresholds
    clear = replace(
        thresholds,
        own=tuple((True,) * len(row) for row in thresholds.own),
        changes=np.ones(len(thresholds.changes)),
    )
    blind = replace(
        clear, own=((False, *clear.own[0][1:]), *clear.own[1:]), changes=np.nan * clear.changes
    )
    texts = []
    for some in (clear, blind):
        console = Console(file=io.StringIO(), width=200)
        replace(content, thresholds=some, events=()).show(console)
        texts.append(console.file.getvalue())
    for words in ("* too few visits in the calibration", "no change is tested"):
        assert words in texts[1] and words not in texts[0]


@pytest.mark.parametrize(
    ("least", "words"),
    [
        (
            0.4321,
            "change of the payload's mass that would be detected: 0.43 kg (for a mass",
        ),
        (float("inf"), "no change of the payload would have been seen: too little motion"),
        (None, ""),
    ],
)
def test_a_stream_says_which_change_of_the_payload_would_be_seen(
    least: float | None, words: str
) -> None:
    nothing = {"gaps": 0, "contacts": 0, "payload_changes": 0, "dropped_rows": {}, "doubt": None}
    summary = {
        **nothing,
        **{"duration_s": 60.0, "samples": 6000, "largest_torque": [1.0], "least_mass_kg": least},
        **{"payload_not_sought": "", "carried_kg": None, "carried_half_width_kg": None},
    }
    text = "\n".join(summary_lines(summary, ("j1",), ("Nm",)))
    assert words in text and ("would" in text) is (least is not None)
    assert "payload at the last search" not in text
    loaded = {**summary, "carried_kg": 2.8371, "carried_half_width_kg": 0.0912}
    assert "payload at the last search: 2.837 ± 0.091 kg" in summary_lines(loaded, ("j1",), ("Nm",))


def test_payload_events_are_printed_as_lines() -> None:
    found = payload_events()
    first, *lines = str(found).splitlines()
    assert first == f"shift: {len(found.events)} changes"
    assert lines[-1] == f"note: {found.notes[0]}"
    for line, event in zip(lines[:-1], found.events, strict=True):
        assert line.startswith(f"{event.kind} at {event.time:.2f} s (")
        assert line.endswith(f"{event.mass:+.3g} ± {event.mass_half_width:.2g} kg")


def test_all_tables_look_alike(usual: ReportContent) -> None:
    text = printed(usual, verbose=True)
    assert "Friction laws compared" in text and "─" in text
    assert not set("┏┃━│┌") & set(text)
