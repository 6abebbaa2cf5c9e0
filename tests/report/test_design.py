"""The report of a designed motion: numbers, words, page and terminal."""

import html
import io
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from browser import Rendered
from report.conftest import EVIL, robot
from report.designed import REACH, designed_for, renamed
from report.test_page import own_html
from steelyard.excite.constraints.bounds_in_time_and_effort_limits import torque_limit
from steelyard.excite.constraints.certificate import proof_of
from steelyard.excite.constraints.constraint_and_limits import Declined, Gap
from steelyard.excite.constraints.tool_workspace import Marker
from steelyard.excite.page.design_page import DESIGN_SECTIONS, render_design
from steelyard.excite.page.design_text import (
    DesignContent,
    brings,
    design_detail,
    design_headline,
    design_level,
    expected,
    instead,
    joint_limits,
    margin,
    nearest,
    print_design,
    tightest,
)
from steelyard.excite.page.tool_path_and_walls import skeleton, tool_path
from steelyard.excite.predicted_accuracy_and_advice import Advice
from steelyard.excite.searched_or_planned_motion import Designed
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.identify.scores_and_model_report import SECTIONS
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.excitation_sections import BoxSpans, PlaneSection, WorkspaceSection

ROOM = WorkspaceSection(
    box=BoxSpans(x=(-1.0, 1.0), z=(-1.0, 1.0)),
    keep_out=(BoxSpans(x=(0.9, 1.0), y=(0.1, 0.2), z=(0.0, 0.1)),),
)


@pytest.fixture(scope="module")
def designed() -> Designed:
    return designed_for(robot())


@pytest.fixture(scope="module")
def beyond() -> Designed:
    return designed_for(robot(), height=0.3, known=False)


def content(designed: Designed) -> DesignContent:
    files = (("trajectory", "trajectory.json"),)
    notes = tuple(n for n in designed.notes if n not in designed.certificate.uncovered)
    return DesignContent(
        "a motion", "arm", notes=notes, design=designed, workspace=ROOM, files=files
    )


def text(page: str) -> str:
    """The words of a page."""
    body = own_html(page)
    body = re.sub(r"<(script|style).*?</\1>", "", body, flags=re.DOTALL)
    plain = re.sub(r"<[^>]*>", "", body).replace("\u00a0", " ").replace("\u2060", "")
    return " ".join(html.unescape(plain).split())


def printed(designed: Designed, width: int = 100, verbose: bool = False) -> str:
    stream = io.StringIO()
    print_design(designed, Console(file=stream, width=width, no_color=True), verbose)
    return stream.getvalue().replace("\u00a0", " ")


def test_predicted_deviations_are_those_of_the_inverse_information(designed: Designed) -> None:
    rows = expected(designed)
    std = np.sqrt(np.diag(np.linalg.inv(designed.shown.gram)))
    by_name = dict(zip(designed.shown.names, std, strict=True))
    for row in rows:
        assert row.std == pytest.approx(by_name[row.name], rel=1e-6)
        assert row.relative_percent == pytest.approx(100.0 * row.std / row.value)
        assert row.spread is not None and row.spread >= 1.0 - 1e-9
    shares = [row.relative_percent for row in rows]
    assert shares == sorted(shares, reverse=True)


def test_without_values_the_most_entangled_parameter_comes_first(beyond: Designed) -> None:
    rows = expected(beyond)
    assert all(row.relative_percent is None for row in rows)
    spreads = [row.spread for row in rows]
    assert spreads == sorted(spreads, reverse=True) and spreads[0] > spreads[-1]


def test_earlier_runs_make_deviations_smaller(designed: Designed) -> None:
    more = replace(designed, prior=3.0 * designed.shown.gram)
    before = {row.name: row.std for row in expected(designed)}
    assert all(row.std == pytest.approx(before[row.name] / 2.0) for row in expected(more))
    assert instead(more, more.advice[0]) == "–"


def test_what_is_not_shown_comes_first_and_is_said(designed: Designed) -> None:
    gram = designed.shown.gram.copy()
    gram[3, :] = gram[:, 3] = 0.0
    blind = replace(designed, shown=replace(designed.shown, gram=gram))
    assert expected(blind)[0].name == designed.shown.names[3]
    words = text(render_design(content(blind)))
    assert "1 base parameter will not be identifiable." in words and "not identifiable" in words
    assert "1 parameter will not be identifiable" in printed(blind)


def test_the_limit_that_is_used_most(designed: Designed) -> None:
    shares = {}
    for j, joint in enumerate(designed.robot.coordinates):
        low, high = designed.trajectory.extremes(1)
        top = max(high[j], -low[j]) / designed.limits.velocity[j]
        shares[joint.name, "velocity"] = top
    for one in designed.certificate.extremes:
        if one.quantity == "velocity":
            assert one.used == pytest.approx(shares[one.joint, "velocity"])
        if one.quantity == "jerk":
            assert one.used is None
    assert 0.85 < max(one.used for one in joint_limits(designed)) <= 0.91


def test_only_what_is_near_its_limit_is_tight(designed: Designed) -> None:
    assert tightest(designed) == []
    certificate = designed.certificate
    (box,) = certificate.proofs
    extremes = tuple(
        replace(one, upper=1.05 * max(abs(one.least), one.greatest), lower=-1e3)
        if one.quantity == "velocity"
        else one
        for one in certificate.extremes
    )
    near = replace(box, scale=(100.0,) * len(box.labels))
    close = replace(certificate, extremes=extremes, proofs=(near,))
    lines = tightest(replace(designed, certificate=close))
    one = r". of 'tip' (above|below) -?1 m, [\d.]+ m left"
    assert re.fullmatch(rf"tool box: {one}; {one}; {one}; \d more", lines[-1])
    symmetric = tuple(
        replace(one, lower=-one.upper) if one.quantity == "velocity" else one for one in extremes
    )
    tight = replace(certificate, extremes=symmetric)
    lines = tightest(replace(designed, certificate=tight))
    both = r"velocity of 2 joints: 9\d\.\d( to 9\d\.\d)? % of their limits used"
    assert re.fullmatch(rf"{both}, which are assumed ones: shoulder, elbow", lines[0])
    limits = replace(designed.limits, share=0.95, assumed=frozenset({("velocity", "elbow")}))
    first, second = sorted(tightest(replace(designed, certificate=tight, limits=limits)))[::-1]
    used = r"9\d\.\d % of its limit used, which is 95 % of"
    assert re.fullmatch(rf"velocity of shoulder: {used} the given one", first)
    assert re.fullmatch(rf"velocity of elbow: {used} an assumed one", second)


def test_margins_are_compared_as_shares_of_their_limits(designed: Designed) -> None:
    certificate = designed.certificate
    (box,) = certificate.proofs
    torque = replace(
        box,
        name="torque",
        unit="Nm",
        labels=("torque of 'a' below 7.6 Nm", "torque of 'b' below 200 Nm"),
        proven=(7.5, 9.0),
        sampled=(7.5, 9.0),
        activation_distance=(0.76, 20.0),
        scale=(7.6, 200.0),
    )
    assert torque.used == pytest.approx((0.1 / 7.6, 0.955))
    told = replace(designed, certificate=replace(certificate, proofs=(box, torque)))
    first, *others = nearest(told)
    assert (first.kind, first.name, first.left) == ("torque", torque.labels[1], 9.0)
    shares = [one.used for one in (first, *others)]
    assert shares == sorted(shares, reverse=True)
    assert {one.kind for one in others} == {"position", "velocity", "acceleration", "tool box"}
    words = text(render_design(content(told)))
    assert "torquetorque of 'b' below 200 Nm9.00 Nm95.5 %" in words
    assert "smallest margin 9.00 Nm (torque of 'b' below 200 Nm)" in words


def test_efforts_are_shares_of_their_limits_and_distances_of_the_activation_distance() -> None:
    arm = robot()
    motion = random_fourier(arm, seed=1, period=4.0, harmonics=4)
    model = Model(arm, (RigidBody(),)).prior
    assert model is not None
    limits = np.array([500.0, 40.0])
    efforts = proof_of(motion, torque_limit({"arm": model}, limits))
    assert efforts.scale == (500.0, 40.0, 500.0, 40.0)
    share = [1.0 - left / size for left, size in zip(efforts.proven, efforts.scale, strict=True)]
    assert efforts.used == pytest.approx(share)
    (box,) = designed_for(arm).certificate.proofs
    assert box.scale == box.activation_distance


def test_the_ball_of_the_tool_and_what_limits_it_are_named(designed: Designed) -> None:
    room = replace_tables(
        ROOM, floor=-1.0, planes=(PlaneSection(normal=(1.0, 0.0, 1.0), above=-3.0),)
    )
    ball = replace(designed, tool=Marker("tip", radius=0.05))
    words = text(render_design(replace(content(ball), workspace=room)))
    assert "'tip' (ball of radius 50 mm): x from" in words
    assert "which stays its radius, 50 mm, away from the limits of the workspace" in words
    assert "box of the tool, plane 1, floorforbidden box" in words
    bare = text(render_design(replace(content(ball), workspace=None)))
    assert "stays its radius" not in bare
    bare = text(render_design(replace(content(designed), workspace=None)))
    assert "radius" not in bare and "forbidden box" not in bare and "floor" not in bare


def replace_tables(room: WorkspaceSection, **changes: object) -> WorkspaceSection:
    return WorkspaceSection.model_validate({**room.model_dump(), **changes})


def test_a_search_that_did_not_end_is_no_best_of_none(designed: Designed) -> None:
    said = design_detail(replace(designed, searches=0))
    assert "best of" not in said and "from an unfinished search of 2.5 s" in said


def test_margins_have_a_unit_for_people() -> None:
    assert margin(0.000113, "m") == "0.113 mm"
    assert margin(-0.02, "m") == "-20.0 mm"
    assert margin(0.25, "m") == "0.250 m"
    assert margin(0.02, "Nm") == "0.0200 Nm"
    assert margin(-np.inf, "m") == "no bound"


def test_a_motion_that_is_not_proven_is_called_so_everywhere(beyond: Designed) -> None:
    assert design_level(beyond) == "poor"
    assert "not safe" in design_headline(beyond)
    words = text(render_design(content(beyond)))
    assert "Not proven: do not run this motion" in words
    assert re.search(r"tool box: z of 'tip' (below|above) -?0\.3 m: violated by 0\.\d+ m", words)
    assert "This motion is not proven to satisfy its limits: do not run it." in words
    lines = printed(beyond)
    assert "not safe" in " ".join(lines.split())
    assert "not proven: tool box: z of 'tip'" in lines


def test_a_safe_motion_says_what_it_shows_and_that_it_is_proven(designed: Designed) -> None:
    every = len(designed.shown.names)
    assert design_headline(designed).startswith(
        f"The motion makes all {every} base parameters identifiable"
    )
    limits = "every limit is proven to hold at all times"
    assert design_headline(designed).endswith(f"; {limits}")
    fainter = replace(designed, faint=3)
    assert design_headline(fainter).startswith(
        f"The motion makes {every} of {every + 3} base parameters identifiable; "
    )
    assert design_level(designed) == "good"
    words = text(render_design(content(designed)))
    figure = f"condition number (raw) {designed.shown.raw:.3g} (smaller is better)"
    assert f"4 s, Fourier series from rest to rest; {figure}, best of 7 searches in 2.5 s" in words
    assert "Limits: tool box (tool point only)." in words
    assert "limits: tool box (tool point only)" in printed(designed, verbose=True)
    assert "the acceleration is a guess" in words and "Assumed: something" in words
    assert "7 searches finished in 2.5 s" in words and "improved 2 times" in words
    longer = text(render_design(content(replace(designed, seconds=3600.4))))
    assert "best of 7 searches in 3600 s" in longer and "finished in 3600 s" in longer
    assert (
        "trajectory.json" in words and "--dry-run 0.2" in words and "(20 s instead of 4 s)" in words
    )


def test_what_was_not_looked_at_is_said(designed: Designed) -> None:
    gap = Gap("torque is not limited: nothing is known <b>")
    told = _noted(designed, gap, "the acceleration is a guess")
    assert "; every checked limit is proven to hold at all times" in design_headline(told)
    assert design_level(told) == "fair"
    words = text(render_design(content(told)))
    assert "Not covered: torque is not limited: nothing is known <b>" in words
    assert "Assumed the acceleration is a guess" in words
    lines = " ".join(printed(told).split())
    assert "not covered: torque is not limited: nothing is known <b>" in lines
    guess = _noted(designed, "the acceleration is a guess")
    assert (
        "; every limit is proven to hold at all times" in design_headline(guess)
        and design_level(guess) == "good"
    )
    assert "Not covered:" not in text(render_design(content(designed)))


def test_what_is_left_out_as_asked_is_said_but_no_reason_to_doubt(designed: Designed) -> None:
    told = _noted(designed, Declined("collisions are not looked at, as asked"))
    assert (
        "; every checked limit is proven" in design_headline(told) and design_level(told) == "good"
    )
    assert "not covered: collisions are not looked at" in " ".join(printed(told).split())


def test_no_search_that_ended_is_said(designed: Designed) -> None:
    told = replace(designed, searches=0)
    assert ", but no search converged; every limit" in design_headline(told)
    assert design_level(told) == "fair"
    assert design_level(replace(told, kind="sweeps")) == "good"


def test_parameters_hidden_behind_others_are_no_good_motion(designed: Designed) -> None:
    size = len(designed.shown.names)
    gram = np.eye(size)
    gram[0, 1] = gram[1, 0] = 0.9999
    told = replace(designed, shown=replace(designed.shown, gram=gram), kind="fourier")
    assert (
        f"The motion makes all {size} base parameters identifiable, 2 of them poorly; "
        in design_headline(told)
    )
    assert design_level(told) == "fair"
    assert design_level(replace(told, chosen=(2, 3))) == "good"
    assert design_level(replace(told, kind="sweeps")) == "good"
    assert design_level(replace(told, chosen=(1, 2))) == "fair"
    gram[0, 1] = gram[1, 0] = 0.99
    assert design_level(replace(told, shown=replace(told.shown, gram=gram))) == "good"


def test_the_way_to_the_start_is_said_not_to_be_covered(designed: Designed) -> None:
    said = "not covered are the approach to the start posture"
    assert said in text(render_design(content(designed))) and said in " ".join(
        printed(designed).split()
    )


def _noted(designed: Designed, *notes: str) -> Designed:
    return replace(designed, notes=notes, certificate=replace(designed.certificate, notes=notes))


def test_advice_tells_from_where_to_where(designed: Designed) -> None:
    again = next(one for one in designed.advice if "repeating" in one.what)
    assert brings(designed, again) == "all parameters to 71 %"
    assert instead(designed, again) == "71 %"
    std = designed.shown.std()
    names = designed.shown.names
    after = std.copy()
    after[2] = std[2] / 4.0
    one = Advice("sweeps", 12.0, after, ((names[2], 0.25),))
    unit = designed.shown.units[2]
    was, becomes = (float(f"{x:.2g}") for x in (std[2], std[2] / 4.0))
    told = re.fullmatch(rf"{re.escape(names[2])} from (\S+) to (\S+) {unit}", brings(designed, one))
    assert told and (float(told[1]), float(told[2])) == (was, becomes)
    assert instead(designed, one) == "50 %"
    nothing = Advice("nothing", 1.0, std, ())
    assert brings(designed, nothing) == "no std below 80 %"


def test_the_terminal_is_short_and_says_the_worst(designed: Designed) -> None:
    lines = printed(designed).splitlines()
    assert len(lines) <= 22
    worst = expected(designed)[0]
    assert any(worst.name in line and f"{worst.relative_percent:.1f} %" in line for line in lines)
    assert sum(" s) reduces " in line for line in lines) == 1
    every = printed(designed, verbose=True)
    assert every.count(" s) reduces ") == 3 and "note: the acceleration is a guess" in every
    assert "note: " not in printed(designed)
    assert max(len(line) for line in printed(designed, 60).splitlines()) <= 60


def test_the_page_of_a_motion_is_about_nothing_else(designed: Designed) -> None:
    page = render_design(content(designed))
    for section in DESIGN_SECTIONS:
        assert f'<section id="{section.name}"' in page
    assert '<section id="verdict"' not in page and "designed with steelyard" in page
    assert not {s.name for s in SECTIONS} & {s.name for s in DESIGN_SECTIONS}


@pytest.mark.slow
@pytest.mark.parametrize("which", ["plain", "evil"])
def test_the_browser_draws_every_picture(
    designed: Designed, browse: Callable[[str], Rendered], which: str
) -> None:
    shown = designed if which == "plain" else renamed(designed, EVIL)
    seen = browse(render_design(content(shown)))
    assert seen.console == () and seen.errors == []
    pictures = seen.dom.count('class="picture')
    assert pictures == 2 + 1 + 3 + 1 + 1
    assert len(re.findall(r'class="picture[^"]*js-plotly-plot"', seen.dom)) == pictures


def test_names_of_strangers_stay_text(designed: Designed) -> None:
    page = own_html(render_design(content(renamed(designed, EVIL))))
    assert "<script>document.body" not in page and '<b>"' not in page
    assert "{{7*7}}" in page and "49}" not in page


def test_the_page_stands_alone(designed: Designed) -> None:
    page = own_html(render_design(content(designed)))
    links = re.findall(r"""(?:src|href|action)\s*=\s*["']?([^"'\s>]*)""", page)
    assert all(link.startswith(("#", "data:")) for link in links)
    assert "http:" not in page and "https:" not in page
    assert len(render_design(content(designed)).encode()) < 6_000_000


def test_the_path_is_that_of_two_links(designed: Designed) -> None:
    arm = designed.robot
    q = np.array([[0.3, -0.7], [1.2, 0.4]])
    path = tool_path(arm, designed.tool, q)
    both = q.sum(axis=1)
    x = 0.4 * np.cos(q[:, 0]) + 0.4 * np.cos(both)
    z = -0.4 * np.sin(q[:, 0]) - 0.4 * np.sin(both)
    np.testing.assert_allclose(path, np.column_stack([x, 0.0 * x, z]), atol=1e-12)
    stick = skeleton(arm, designed.tool, q[0])
    ends = stick.reshape(-1, 3, 3)
    assert np.isnan(ends[:, 2]).all()
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(REACH)
    np.testing.assert_allclose(ends[-1, 1], path[0])
