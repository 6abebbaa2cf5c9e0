"""The figures about a model: their numbers against the samples and the model they come from."""

import base64
import json
from dataclasses import replace

import numpy as np
import pytest

from invented import ball
from report.conftest import rendered_only
from steelyard.base.arrays import Z95, Parameters
from steelyard.estimate.scores.parts_and_bands_along_run import PARTS
from steelyard.identify.page import efforts_their_parts_and_residuals as efforts
from steelyard.identify.page.conditioning_correlations_and_repeats import (
    CorrelationsSection,
    correlations,
)
from steelyard.identify.page.efforts_their_parts_and_residuals import (
    MOST_POINTS_OF_TORQUE_PART,
    TORQUE_PARTS,
    ResidualsSection,
    TorqueSplitSection,
    binned,
)
from steelyard.identify.page.friction_choice_and_curves import FrictionCurvesSection, curves_of
from steelyard.identify.page.link_inertias_and_ellipsoids import (
    EllipsoidsSection,
    MassesSection,
    semi_axes,
)
from steelyard.identify.page.parameters_and_truth import TruthSection
from steelyard.identify.page.report_content_and_error_words import ReportContent, pooled_samples
from steelyard.identify.scores_and_model_report import render
from steelyard.report.page_figures import Figure
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Frame, frame_origins


def unpacked(values: dict[str, str]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(values["bdata"]), f"<{values['dtype']}")


def drawn(figure: Figure, name: str) -> tuple[np.ndarray, np.ndarray]:
    traces = {trace["name"]: trace for trace in json.loads(figure.json)["traces"]}
    return unpacked(traces[name]["x"]), unpacked(traces[name]["y"])


def test_the_parts_of_the_figure_add_up_to_the_prediction(usual: ReportContent) -> None:
    numbers = TorqueSplitSection().numbers(usual)
    assert numbers is not None and numbers["words"].startswith("Run points (not fitted).")
    parts = usual.scores[0].parts
    for j, group in enumerate(numbers["groups"]):
        (figure,) = group.figures
        names = [trace["name"] for trace in figure.traces]
        assert names == ["measured", "predicted", *(TORQUE_PARTS[name][0] for name in PARTS[:4])]
        t, predicted = drawn(figure, "predicted")
        total = sum(drawn(figure, TORQUE_PARTS[name][0])[1] for name in PARTS[:4])
        np.testing.assert_allclose(total, predicted, rtol=1e-5, atol=1e-4)
        at = np.searchsorted(parts.t, t - 1e-3)
        np.testing.assert_allclose(predicted, parts.predicted[at, j], rtol=1e-6)
        assert len(t) <= MOST_POINTS_OF_TORQUE_PART


def test_many_joints_share_the_points(
    usual: ReportContent, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(efforts, "MOST_POINTS_OF_TORQUE_PARTS", 100 * 7 * 2)
    numbers = TorqueSplitSection().numbers(usual)
    (figure,) = numbers["groups"][1].figures
    assert 50 <= len(drawn(figure, "predicted")[0]) <= 100
    assert "at most 100 evenly spaced points" in numbers["note"]


def test_sizes_of_parts_are_their_root_mean_squares_in_motion(usual: ReportContent) -> None:
    """Of all samples for the second joint, which rests throughout."""
    score = usual.scores[0]
    moving = score.parts.moving.copy()
    moving[:, 1] = False
    assert 0 < np.count_nonzero(moving[:, 0]) < len(moving)
    parts = replace(score.parts, moving=moving)
    resting = replace(usual, scores=(replace(score, parts=parts),))
    found = TorqueSplitSection().to_dict(resting)["torque_split"]
    assert found["run"] == "points"
    for j, joint in enumerate(found["joints"]):
        for name, part in zip(PARTS, parts.parts, strict=True):
            rms = np.sqrt(np.mean(part[moving[:, 0] if j == 0 else slice(None), j] ** 2))
            assert joint[name] == pytest.approx(rms, rel=1e-5)
    assert [joint["other"] for joint in found["joints"]] == [0.0, 0.0]


def test_lines_break_where_time_jumps(usual: ReportContent) -> None:
    score = usual.scores[0]
    t = score.parts.t + 50.0 * (score.parts.t > 10.0)
    cut = replace(usual, scores=(replace(score, parts=replace(score.parts, t=t)),))
    (figure,) = TorqueSplitSection().numbers(cut)["groups"][0].figures
    x, y = drawn(figure, "predicted")
    (gap,) = np.flatnonzero(np.isnan(y))
    assert np.isnan(x[gap]) and x[gap - 1] <= 10.0 < x[gap + 1]


def test_friction_is_drawn_up_to_the_fastest_sample_with_what_was_measured(
    usual: ReportContent,
) -> None:
    numbers = FrictionCurvesSection().numbers(usual)
    parts, runs = pooled_samples(usual, "fitted")
    assert runs == "1 fitted run" and runs in numbers["note"]
    for j, (curve, figure) in enumerate(
        zip(curves_of(usual), numbers["groups"][0].figures, strict=True)
    ):
        speed, friction = drawn(figure, "friction")
        np.testing.assert_allclose(friction, curve.effort, rtol=1e-6)
        moving = parts.moving[:, j]
        assert speed[-1] == pytest.approx(np.abs(parts.dq[moving, j]).max(), rel=1e-6)
        dq, measured = drawn(figure, "measured")
        at = [np.flatnonzero(np.isclose(parts.dq[:, j], x, atol=1e-6)) for x in dq[:20]]
        others = parts.parts[[0, 1, 2, 4]].sum(axis=0)
        expected = parts.measured[:, j] - others[:, j]
        for y, alike in zip(measured, at, strict=False):
            assert np.isclose(expected[alike], y, rtol=1e-5).any()
        _, band = drawn(figure, "95 % interval")
        assert np.isfinite(band).all()
        names = [trace["name"] for trace in figure.traces]
        assert names == ["95 % interval", "95 % interval", "measured", "friction"]
        assert figure.traces[0]["more"]["opacity"] < 1.0
    written = FrictionCurvesSection().to_dict(usual)["friction_curves"]
    assert [one["joint"] for one in written] == ["shoulder", "elbow"]
    assert written[0]["friction"][-1] == pytest.approx(curves_of(usual)[0].effort[-1], rel=1e-5)


def test_bins_hold_the_mean_of_their_samples() -> None:
    rng = np.random.default_rng(0)
    over = np.append(rng.uniform(-2.0, 2.0, 3998), [-2.0, 2.0])
    residual = np.where(over > 0.0, 1.0, -1.0) + 0.1 * rng.normal(size=4000)
    found = binned(over, residual)
    np.testing.assert_allclose(found.mean, np.sign(found.centre), atol=0.05)
    np.testing.assert_allclose(found.std, 0.1, atol=0.03)
    assert found.share == pytest.approx(1.0 / 1.01, abs=0.005)
    assert binned(rng.uniform(-2.0, 2.0, 4000), residual).share < 0.02
    few = binned(np.array([0.0, 0.0, 1.0]), np.ones(3))
    assert len(few.centre) == 0 and few.share == 0.0


def test_the_residual_is_that_of_the_runs_that_were_not_fitted(usual: ReportContent) -> None:
    parts, runs = pooled_samples(usual, "validation")
    assert runs == "2 validation runs" and len(parts.t) == 4000
    at = parts.moving[:, 0]
    expected = binned(parts.dq[at, 0], parts.measured[at, 0] - parts.predicted[at, 0])
    figures = ResidualsSection().numbers(usual)["groups"][0].figures
    speed, mean = drawn(figures[1], "mean")
    np.testing.assert_allclose(speed, expected.centre, rtol=1e-6)
    np.testing.assert_allclose(mean, expected.mean, rtol=1e-5, atol=1e-6)
    share = ResidualsSection().to_dict(usual)["residual_shares"][0]["speed"]
    assert share == pytest.approx(expected.share, rel=1e-5)


def test_masses_and_centres_are_those_of_the_estimate_and_of_the_file(usual) -> None:
    standard = usual.identified.estimate.standard
    value, bodies = standard.parameters, usual.identified.model.robot.bodies
    masses, *shifts = (
        figure for group in MassesSection().numbers(usual)["groups"] for figure in group.figures
    )
    marks = {trace["name"]: trace for trace in masses.traces}
    names = [body.name for body in bodies]
    assert marks["identified"]["y"] == marks["model file"]["y"] == names
    assert marks["identified"]["x"] == [value[f"m.{name}"] for name in names]
    std = [standard.parameters.names.index(f"m.{name}") for name in names]
    half = Z95 * np.sqrt(np.diag(standard.covariance))[std]
    found = marks["identified"]["more"]["error_x"]["array"]
    np.testing.assert_allclose(found, half, rtol=1e-5)
    assert marks["model file"]["x"] == [body.inertia.mass for body in bodies]
    np.testing.assert_allclose(marks["truth"]["x"], [1.03 * x for x in marks["identified"]["x"]])
    np.testing.assert_allclose(marks["prior"]["x"], [10.0, 18.5])
    assert len(shifts) == 3
    written = MassesSection().to_dict(usual)["bodies"]
    for axis, figure in enumerate(shifts):
        marks = {trace["name"]: trace for trace in figure.traces}
        for k, body in enumerate(bodies):
            centre = [value[f"{m}.{body.name}"] for m in ("mx", "my", "mz")][axis]
            shift = 1e3 * (centre / value[f"m.{body.name}"] - body.inertia.com[axis])
            assert marks["identified"]["x"][k] == pytest.approx(shift, abs=1e-4)
            half = 1e3 * written[k]["centre_half_width"][axis]
            assert marks["identified"]["more"]["error_x"]["array"][k] == pytest.approx(half)


def test_without_standard_parameters_there_are_no_bodies(usual) -> None:
    estimate = replace(usual.identified.estimate, standard=None)
    base_only = replace(usual, identified=replace(usual.identified, estimate=estimate))
    assert MassesSection().numbers(base_only) is None
    assert EllipsoidsSection().numbers(base_only) is None
    assert MassesSection().to_dict(base_only) == {"bodies": None}


def test_an_ellipsoid_has_the_inertia_of_its_body() -> None:
    body = ball(3)
    lengths, directions = semi_axes(body)
    squares = lengths**2
    moments = body.mass / 5.0 * (squares.sum() - squares)
    own = directions @ np.diag(moments) @ directions.T
    np.testing.assert_allclose(own, body.inertia_com, rtol=1e-9, atol=1e-12)
    assert semi_axes(Inertia.about_com(-1.0, np.zeros(3), np.eye(3))) is None
    assert semi_axes(Inertia.about_com(1.0, np.zeros(3), np.diag([1.0, 1.0, 3.0]))) is None


def test_ellipsoids_stand_where_the_links_are(usual) -> None:
    ((figure,),) = (group.figures for group in EllipsoidsSection().numbers(usual)["groups"])
    traces = {trace["name"]: trace for trace in figure.traces}
    parts, _ = pooled_samples(usual, "fitted")
    robot = usual.identified.model.robot
    joints = parts.q[len(parts.q) // 2]
    frames = [Frame("c", k, np.eye(3), body.inertia.com) for k, body in enumerate(robot.bodies)]
    expected = frame_origins(robot, frames, joints[None])[0]

    def points(name: str) -> np.ndarray:
        own = traces[name]
        return np.column_stack([unpacked(x) for x in (own["x"], own["y"], own["more"]["z"])])

    np.testing.assert_allclose(points("centres in the file"), expected, atol=1e-6)
    surface = points("identified").reshape(len(frames), -1, 3)
    np.testing.assert_allclose(surface.mean(axis=1), points("identified centres"), atol=1e-5)
    faces = np.column_stack([traces["identified"]["more"][k] for k in "ijk"])
    half = len(surface[0])
    assert faces.max() == 2 * half - 1 and np.all(faces // half == faces[:, :1] // half)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    assert np.all(np.unique(edges, axis=0, return_counts=True)[1] == 2)


def test_the_map_holds_the_correlations_of_the_covariance(usual) -> None:
    estimate = usual.identified.estimate
    ((figure,),) = (group.figures for group in CorrelationsSection().numbers(usual)["groups"])
    (trace,) = figure.traces
    z = unpacked(trace["more"]["z"]).reshape(len(trace["x"]), -1)
    expected = estimate.covariance / np.outer(estimate.std, estimate.std)
    np.testing.assert_array_equal(z, np.rint(100.0 * expected))
    assert trace["x"] == trace["y"] == list(estimate.parameters.names)
    fixed = replace(estimate, at_bound=estimate.parameters.names[:1])
    assert correlations(fixed)[0] == estimate.parameters.names[1:]


def test_a_large_map_keeps_the_strongest_correlations(usual) -> None:
    estimate = usual.identified.estimate
    names, matrix, left_out = correlations(estimate, most=3)
    assert names[:2] == estimate.parameters.names[:2] and left_out == len(estimate.parameters) - 3
    assert matrix[0, 1] == pytest.approx(0.95)


def test_the_truth_is_inside_or_outside_the_intervals(usual) -> None:
    base, estimate = usual.identified.base, usual.identified.estimate
    true = dict(zip(base.base_names, base.lift @ usual.truth.values, strict=True))
    found = TruthSection().to_dict(usual)["truth"]
    assert [one["name"] for one in found] == list(estimate.parameters.names)
    for one, value, half in zip(
        found, estimate.parameters.values, estimate.half_width, strict=True
    ):
        assert one["truth"] == pytest.approx(true[one["name"]])
        assert one["inside"] == (abs(value - true[one["name"]]) <= half)
    inside = sum(one["inside"] for one in found)
    words = f"{inside} of {len(found)} base parameters lie in the 95 % intervals"
    assert words in TruthSection().numbers(usual)["words"]
    (line,) = TruthSection().printed(usual)
    assert words in line.plain
    own = dict(zip(estimate.parameters.names, estimate.parameters.values, strict=True))
    exact = Parameters(base.names, base.units, [own.get(name, 0.0) for name in base.names])
    independent = replace(usual, truth=exact)
    leads = {base.names[k] for k in base.dependent}
    assert not leads & set(own)
    assert all(one["inside"] for one in TruthSection().to_dict(independent)["truth"])
    real = replace(usual, truth=None)
    assert TruthSection().numbers(real) is None and TruthSection().to_dict(real) == {"truth": None}


def test_without_samples_there_are_no_figures_of_efforts(usual: ReportContent) -> None:
    scores = tuple(replace(score, parts=None) for score in usual.scores)
    bare = replace(usual, scores=scores, fitted=())
    for section in (TorqueSplitSection(), FrictionCurvesSection(), ResidualsSection()):
        assert section.numbers(bare) is None
    assert 'id="residuals"' not in render(bare)


@pytest.mark.slow
def test_the_browser_draws_figures_in_the_colours_of_the_page(browse, usual) -> None:
    seen = browse(rendered_only(usual, "friction-curves", "torque-split"))
    assert seen.console == () and seen.errors == []
    part = seen.dom.split('<section id="friction-curves"')[1].split("</section>")[0]
    assert part.count('class="picture js-plotly-plot"') == 2
    assert "stroke: rgb(213, 94, 0)" in part and "fill: rgb(0, 114, 178)" in part
    split = seen.dom.split('<section id="torque-split"')[1].split("</section>")[0]
    assert split.count('class="picture js-plotly-plot"') == 1
    assert split.count('class="picture"') == 1
