"""The figures about a model: their numbers against the samples and the model they come from."""

import base64
import json
from dataclasses import replace

import numpy as np
import pytest

from steelyard.report import ReportContent, render
from steelyard.report.figures import Figure
from steelyard.report.parts import fitted_samples, unseen_samples
from steelyard.report.sections.model.friction_curves import FrictionCurvesSection, curves_of
from steelyard.report.sections.model.residuals import ResidualsSection, binned
from steelyard.report.sections.model.torque_split import POINTS, WORDS, TorqueSplitSection
from steelyard.validation.torque_parts import PARTS


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
        assert names == ["measured", "predicted", *(WORDS[name] for name in PARTS[:4])]
        t, predicted = drawn(figure, "predicted")
        total = sum(drawn(figure, WORDS[name])[1] for name in PARTS[:4])
        np.testing.assert_allclose(total, predicted, rtol=1e-5, atol=1e-4)
        at = np.searchsorted(parts.t, t - 1e-3)
        np.testing.assert_allclose(predicted, parts.predicted[at, j], rtol=1e-6)
        assert len(t) <= POINTS


def test_sizes_of_parts_are_their_root_mean_squares(usual: ReportContent) -> None:
    found = TorqueSplitSection().to_dict(usual)["torque_split"]
    parts = usual.scores[0].parts
    assert found["run"] == "points"
    for j, joint in enumerate(found["joints"]):
        for name, part in zip(PARTS, parts.parts, strict=True):
            rms = np.sqrt(np.mean(part[:, j] ** 2))
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
    parts, runs = fitted_samples(usual)
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
        for y, places in zip(measured, at, strict=False):
            assert np.isclose(expected[places], y, rtol=1e-5).any()
        _, band = drawn(figure, "95 % interval")
        assert np.isfinite(band).all()
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
    parts, runs = unseen_samples(usual)
    assert runs == "2 validation runs" and len(parts.t) == 4000
    at = parts.moving[:, 0]
    expected = binned(parts.dq[at, 0], parts.measured[at, 0] - parts.predicted[at, 0])
    figures = ResidualsSection().numbers(usual)["groups"][0].figures
    speed, mean = drawn(figures[1], "mean")
    np.testing.assert_allclose(speed, expected.centre, rtol=1e-6)
    np.testing.assert_allclose(mean, expected.mean, rtol=1e-5, atol=1e-6)
    share = ResidualsSection().to_dict(usual)["residual_shares"][0]["speed"]
    assert share == pytest.approx(expected.share, rel=1e-5)


def test_without_samples_there_are_no_figures_of_efforts(usual: ReportContent) -> None:
    scores = tuple(replace(score, parts=None) for score in usual.scores)
    bare = replace(usual, scores=scores, fitted=())
    for section in (TorqueSplitSection(), FrictionCurvesSection(), ResidualsSection()):
        assert section.numbers(bare) is None
    assert 'id="residuals"' not in render(bare)


def test_the_browser_draws_figures_in_the_colours_of_the_page(browse, usual) -> None:
    seen = browse(render(usual))
    assert seen.console == () and seen.errors == []
    part = seen.dom.split('<section id="friction-curves"')[1].split("</section>")[0]
    assert part.count('class="picture js-plotly-plot"') == 2
    assert "stroke: rgb(213, 94, 0)" in part and "fill: rgb(0, 114, 178)" in part
    split = seen.dom.split('<section id="torque-split"')[1].split("</section>")[0]
    assert split.count('class="picture js-plotly-plot"') == 1
    assert split.count('class="picture"') == 1
