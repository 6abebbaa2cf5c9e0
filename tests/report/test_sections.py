"""What the sections say."""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from report.conftest import identified, robot
from steelyard.base.arrays import Parameters
from steelyard.estimate.reduction.stopping_rules_and_reduction import Reduction
from steelyard.identify.page.parameters_and_truth import parameter_rows
from steelyard.identify.page.reduction_and_removals import measure_of
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.identify.scores_and_model_report import SECTIONS
from steelyard.identify.verdict_and_next_steps import (
    error_limit_words,
    exit_code,
    level_of,
    next_steps,
    verdict,
)
from steelyard.report.page import PageContent, Section
from steelyard.report.words import percent

BY_NAME: dict[str, Section] = {section.name: section for section in SECTIONS}


def shown(name: str, content: ReportContent) -> str:
    section = BY_NAME[name]
    numbers = section.numbers(content)
    assert numbers is not None
    return section.show(numbers)


def with_errors(content: ReportContent, *joints: int, **errors) -> ReportContent:
    """The first run alone, with other errors of these joints, or of all."""
    score = content.scores[0]
    changed = tuple(
        replace(joint, **errors) if k in joints or not joints else joint
        for k, joint in enumerate(score.errors.joints)
    )
    score = replace(score, errors=replace(score.errors, joints=changed))
    return replace(content, scores=(score,))


def test_every_field_of_the_json_output_has_one_section(usual: ReportContent) -> None:
    fields = Counter(field for section in SECTIONS for field in section.to_dict(usual))
    assert [field for field, number in fields.items() if number > 1] == []


def test_the_page_has_the_level_and_what_parameters_are_good_for(usual: ReportContent) -> None:
    words = shown("verdict", replace(usual, scores=usual.scores[:1]))
    assert '<p class="headline">GOOD: Predicts unseen motion' in words
    assert "13 base parameters: 9 identified, 1 small effect" in words
    assert "<dt>base parameters identified or of small effect</dt>" in words
    assert ">10 of 13<" in words
    assert "rely on single values only if identified, and" in words
    alone = shown("verdict", replace(usual, only_errors=True))
    assert "as single values" not in alone and "9 identified" not in alone


def test_errors_of_fitted_runs_are_shares_of_the_effort_used(usual: ReportContent) -> None:
    words = shown("verdict", usual)
    assert (
        "<dt>error of the fitted runs, of the effort used, in the band of the headline</dt>"
        in words
    )
    assert "the fitted runs, Nm" not in words


@pytest.mark.parametrize(
    ("names", "samples"),
    [
        (("m.link", "viscous.elbow"), "where they move"),
        (("m.link", "maxwell_slip1.elbow"), "whole log"),
    ],
)
def test_errors_of_a_reduction_are_over_the_samples_that_were_fitted(
    names: tuple[str, ...], samples: str
) -> None:
    path = SimpleNamespace(full=SimpleNamespace(names=names))
    measure = measure_of(cast(Reduction, SimpleNamespace(path=path)))
    assert measure.endswith(f", {samples}")


def test_the_verdict_comes_first_and_titles_differ():
    assert SECTIONS[0].name == "verdict"
    assert len({s.name for s in SECTIONS}) == len({s.title for s in SECTIONS}) == len(SECTIONS)


def test_the_headline_is_in_joint_effort_with_its_shares_and_its_band(usual):
    judged = verdict(replace(usual, scores=usual.scores[:1]))
    assert judged.headline == (
        "Predicts unseen motion with an error of 1.3 Nm: 5.0\u00a0% of the effort used"
    )
    assert judged.detail == (
        "RMS below 5 Hz, pooled over 2 joints, where they move, 30 s each; "
        "2.5\u00a0% of the joints' effort limits."
    )
    assert judged.others == (
        "Relative error ‖measured − predicted‖ / ‖measured‖ in logged units, in the validation "
        "band, below 8 Hz: "
        "5.0\u00a0% over all joints together, where they move; 9.0\u00a0% over all joints "
        "together, whole log; 7.5\u00a0% mean over joints, where they move; 10.0\u00a0% mean over "
        "joints, whole log."
    )
    assert judged.level == "good"
    assert judged.percent_of_used == pytest.approx(5.0)
    assert "6.7\u00a0%" in verdict(usual).headline


def test_a_joint_that_carries_nothing_does_not_rule(usual):
    idle = with_errors(usual, 1, error=0.6, used=0.5, least=6.0)
    judged = verdict(idle)
    assert judged.level == "good" and "elbow" not in judged.headline
    poor = verdict(with_errors(usual, 1, error=3.0, used=0.5, least=6.0))
    assert poor.headline.endswith(" of the effort used (elbow 50.0\u00a0%)")


def test_plots_of_efforts_state_their_band_and_unit_and_have_the_errors_of_the_verdict(usual):
    html = shown("effort", usual)
    assert "Lines: efforts in A, the unit of the log, below 8 Hz, the validation band. " in html
    assert "those of the verdict, in Nm at the joints, below 5 Hz." in html
    found = BY_NAME["effort"].numbers(usual)["figures"][1]["caption"]
    error = usual.scores[0].errors.joints[1]
    share = f"{error.percent_of_used:.1f}\u00a0%"
    assert found == f"error {error.error:.2f} Nm: {share} of the effort used"
    own = tuple(replace(joint, unit="A") for joint in usual.scores[0].errors.joints)
    errors = replace(usual.scores[0].errors, cutoff=8.0, joints=own)
    alike = replace(usual, scores=(replace(usual.scores[0], errors=errors),), fitted=())
    assert "those of the verdict: A, below 8 Hz." in shown("effort", alike)


def test_motor_torques_under_errors_at_the_joints_are_said_apart(usual):
    """Both are in Nm, with a gear ratio between them."""
    signals = replace(usual.identified.signals, effort_units=("Nm", "Nm"))
    (score,) = usual.scores[:1]
    joints = tuple(replace(joint, unit="Nm") for joint in score.joints)
    errors = replace(score.errors, cutoff=score.cutoff)
    alike = replace(usual, scores=(replace(score, joints=joints, errors=errors),), fitted=())
    assert not np.allclose(np.abs(signals.gains), 1.0)
    motors = replace(alike, identified=replace(usual.identified, signals=signals))
    html = shown("effort", motors)
    assert "Lines: efforts in Nm before gains and gears, the unit of the log, below 8 Hz. " in html
    assert "those of the verdict, in Nm at the joints, below 8 Hz." in html
    unit = replace(signals, gains=np.array([1.0, -1.0]))
    joint = replace(alike, identified=replace(usual.identified, signals=unit))
    assert "those of the verdict: Nm, below 8 Hz." in shown("effort", joint)


def test_joints_above_ten_percent_stand_in_a_good_headline(usual):
    for error, named in ((0.6, False), (0.602, False), (0.61, True), (2.0, True)):
        judged = verdict(with_errors(usual, 1, error=error, used=6.0))
        assert judged.level == "good" or error == 2.0
        assert ("(elbow " in judged.headline) == named


def test_efforts_of_different_units_are_not_pooled(usual):
    judged = verdict(with_errors(usual, 1, unit="N", error=6.0, limit=None))
    assert (
        "error of 1.0 Nm: 5.0\u00a0% of the effort used; 6.0 N: 20.0\u00a0% of the effort used "
        "(elbow 20.0\u00a0%)" in judged.headline
    )
    assert judged.detail.endswith(
        "where they move, 30 s each; 2.0\u00a0% of the joints' effort limits."
    )
    assert judged.level == "fair" and len(judged.errors) == 2


def test_joints_at_rest_are_not_counted_while_others_move(usual):
    resting = verdict(with_errors(usual, 1, counted=False, error=90.0))
    assert "pooled over the 1 of 2 joints that move, where they move" in resting.detail
    assert "error of 1.0 Nm" in resting.headline and "elbow" not in resting.headline
    score = usual.scores[0]
    still = replace(score, errors=replace(score.errors, at_rest=True))
    judged = verdict(replace(usual, scores=(still,)))
    assert judged.headline.startswith("Predicts unseen postures with an error of 1.3 Nm")
    assert "pooled over 2 joints, at rest" in judged.detail


def test_a_useless_model_is_called_so(usual):
    judged = verdict(with_errors(usual, error=33.0))
    assert "no better than predicting zero" in judged.headline
    assert "33 Nm: 129\u00a0% of the effort used" in judged.headline
    assert judged.level == "poor"


@pytest.mark.parametrize("strange", [{"error": float("nan")}, {"used": 0.0, "least": 0.0}])
def test_no_percentage_without_measured_effort(usual, strange):
    judged = verdict(with_errors(usual, **strange))
    assert judged.level == "none"
    assert "cannot be given" in judged.headline and "shoulder, elbow" in judged.detail


def test_no_verdict_without_an_unseen_run(usual):
    judged = verdict(replace(usual, scores=()))
    assert judged.headline == "Not validated on unseen motion"
    assert "1 fitted run with an error of 0.76 Nm: 3.0\u00a0% of the effort used" in judged.detail
    assert "RMS below 5 Hz, pooled over 2 joints, where they move" in judged.detail
    assert "steelyard validate MODEL OTHER_LOG" in judged.detail
    assert judged.level == "none"


def test_a_poor_verdict_is_exit_code_1(usual):
    untested = replace(usual, scores=())
    bad = (with_errors(usual, error=8.0), usual, untested)
    assert [exit_code(content) for content in bad] == [1, 0, 0]


@pytest.mark.parametrize(
    ("error", "level", "says"),
    [
        (7.0, "none", ""),
        (8.0, "poor", ". Predicts fitted motion with an error of 8.0 Nm: 31.4\u00a0% of the"),
        (33.0, "poor", ". Predicts fitted motion no better than predicting zero: the error is 33"),
    ],
)
def test_a_fit_that_does_not_describe_its_own_logs_is_poor(usual, error, level, says):
    fitted = with_errors(usual, error=error).scores
    content = replace(usual, scores=(), fitted=fitted)
    judged = verdict(content)
    assert judged.level == level and exit_code(content) == (level == "poor")
    assert judged.headline.startswith(f"Not validated on unseen motion{says}")
    assert "steelyard validate MODEL OTHER_LOG" in judged.detail
    assert judged.errors == () and error_limit_words(judged, 8.0).startswith("No error on unseen")
    commands = [command for command, _ in next_steps(content, "arm.toml", Path("m"))]
    assert ("steelyard check arm.toml" in " ".join(commands)) == (level == "poor")


def test_levels():
    errors = (None, float("nan"), 10.04, 10.06, 30.04, 30.1, float("inf"))
    assert [level_of(e) for e in errors] == ["none", "none", "good", "fair", "fair", "poor", "poor"]
    assert [percent(e) for e in errors[2:5]] == ["10.0\u00a0%", "10.1\u00a0%", "30.0\u00a0%"]


def test_poor_parameters_are_marked(usual):
    table = parameter_rows(usual.identified)
    words = ["identified", "poorly identified", "small effect", "identified"]
    assert [row.status for row in table[:4]] == words
    assert table[-1].status == "not identifiable" and table[-1].value is None
    assert len(table) == len(usual.identified.base)
    html = shown("parameters", usual)
    assert html.count('<span class="hint fair alone">poorly identified</span>') == 1
    assert html.count('<td class="text status">small effect</td>') == 1
    assert html.count('class="bar"') == 2 * 12 - 1  # none of the one with a small effect
    assert "12 in the table: 9 identified, 1 small effect, 1 poorly identified, 1 from the" in html
    assert "mx.link of shoulder + 0.4 m.link of elbow" in html
    assert table[-1].name not in html


def test_intervals_and_nominal_values(usual):
    estimate = usual.identified.estimate
    first = parameter_rows(usual.identified)[0]
    assert first.upper95 - first.lower95 == pytest.approx(2 * 1.959964 * estimate.std[0])
    assert first.relative_std_percent == pytest.approx(3.0)
    assert first.nominal == pytest.approx(2.0 * 0.2 + 0.4 * 2.0)
    friction = next(r for r in parameter_rows(usual.identified) if r.name == "viscous.elbow")
    assert friction.nominal is None


def test_what_is_not_seen_is_named_with_its_twin(usual):
    html = shown("unseen", usual)
    assert "28 standard parameters" in html and "on 13 combinations" in html
    assert "<code>m.link of shoulder</code>" in html
    assert "not distinguishable from mx.link of shoulder" in html
    estimate = replace(usual.identified.estimate, blind=())
    clear = replace(usual, identified=replace(usual.identified, estimate=estimate))
    assert "every base parameter has an effect that differs" in shown("unseen", clear)


def test_conditioning_says_what_trades_against_what(usual):
    html = shown("conditioning", usual)
    assert "41.5" in html and "812" in html and "0.950" in html
    assert "1.1 std" in html and "[std of both]" in html
    assert "0.0340" in html and "4200" in html


def test_quality_has_a_column_per_label(usual):
    html = shown("quality", usual)
    assert html.count('<th scope="col"') == 5
    assert "1, longest 0.4\u00a0s" in html and "12 (not a number)" in html


def test_settings_show_hashes_and_notes_once(usual):
    html = shown("settings", usual)
    assert "ab" * 32 in html and "run1@0.6:9.5" in html and "25\u00a0Hz" in html
    assert html.count("clock: 100\u00a0Hz") == html.count("velocity: from positions") == 1
    repeated = replace(usual, notes=("clock: 100 Hz",))
    assert shown("settings", repeated).count("clock: 100\u00a0Hz") == 1


def test_sections_without_anything_to_show_are_left_out():
    plain = ReportContent("title", "arm", identified=identified(robot()))
    left = [s.name for s in SECTIONS if s.numbers(plain) is not None]
    of_the_model = ["parameters", "masses", "ellipsoids", "bodies", "per-run", "evolution"]
    assert left == ["verdict", *of_the_model, "unseen", "conditioning", "correlations", "settings"]
    some = replace(plain, settings=(("a", "b"),))
    assert "<dt>a</dt><dd>b</dd>" in shown("settings", some)
    empty = PageContent("title", "arm")
    assert all(BY_NAME[name].numbers(empty) is None for name in ("quality", "settings"))


def test_estimates_are_compared_in_the_std_of_both(usual):
    """One that a prior holds in place, beside one that knows next to nothing."""
    estimate = usual.identified.estimate
    names, size = estimate.parameters.names, len(estimate.parameters)
    std = np.full(size, 1e-6)
    sure = replace(estimate, covariance=np.diag(std**2))
    moved = estimate.parameters.values.copy()
    moved[4] += 3.0
    parameters = Parameters(names, estimate.parameters.units, moved)
    loose = replace(sure, parameters=parameters, covariance=np.diag(np.full(size, 4.0)))
    both = replace(usual.identified, estimate=sure, reference=(loose,))
    html = shown("conditioning", replace(usual, identified=both))
    assert f"{names[4]}: 1.5 std" in html


def test_groupings_stand_in_rows_of_their_own(usual):
    html = shown("parameters", usual)
    assert '<input type="checkbox" id="parameter-groups"' in html
    groups = [row for row in parameter_rows(usual.identified) if row.status != "not identifiable"]
    folded = [row for row in groups if row.group != row.name]
    assert html.count('<tr class="group follows">') == len(folded) > 0
    assert "mx.<wbr>link of shoulder" in html and "+&nbsp;1</small>" in html


def test_what_is_long_of_a_log_stands_below_it(usual):
    long = "resampled to 100 Hz; " * 9
    more = (("run1", (("rows", "12"), ("processing", long))), ("points", (("rows", "13"),)))
    html = shown("quality", replace(usual, qualities=more))
    assert html.count('<th scope="col"') == 2 and html.count('<tr class="below follows">') == 1
    assert "processing: resampled to 100\u00a0Hz" in html


def test_what_a_bound_holds_trades_against_nothing(usual):
    first = usual.identified.estimate.parameters.names[0]
    estimate = replace(usual.identified.estimate, at_bound=(first,))
    html = shown(
        "conditioning", replace(usual, identified=replace(usual.identified, estimate=estimate))
    )
    assert "0.950" in shown("conditioning", usual) and "0.950" not in html
