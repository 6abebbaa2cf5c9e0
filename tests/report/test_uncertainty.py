"""What the report says of uncertainty: bands, shares from data, bodies."""

import base64
import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from report.conftest import rendered_only
from steelyard.identify.page.efforts_their_parts_and_residuals import EffortSection
from steelyard.identify.page.link_inertias_and_ellipsoids import (
    BodiesSection,
    identified_links,
    margin,
)
from steelyard.identify.page.parameters_and_truth import ParametersSection, parameter_rows
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.identify.scores_and_model_report import parameters_csv, print_report, render
from steelyard.report.page_figures import outline
from steelyard.robot.inertia_and_placement import Inertia


def decoded(packed: dict[str, str]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(packed["bdata"]), "<f4")


def printed(content: ReportContent) -> str:
    console = Console(file=io.StringIO(), width=200)
    print_report(content, console, verbose=True)
    return console.file.getvalue()


def with_estimate(content: ReportContent, **changes) -> ReportContent:
    identified = content.identified
    return replace(
        content, identified=replace(identified, estimate=replace(identified.estimate, **changes))
    )


def test_bands_lie_around_the_prediction(usual):
    traces = usual.scores[0].traces
    figure = EffortSection().numbers(usual)["figures"][1]
    assert len(figure["bands"]) == 3
    measurement, model, residual = (decoded(area["y"]) for area in figure["bands"])
    assert np.nanmax(measurement) == pytest.approx(
        (traces.predicted + traces.band)[:, 1].max(), rel=1e-5
    )
    sure = traces.predicted + 1.959964 * traces.model_std
    assert np.nanmax(model) == pytest.approx(sure[:, 1].max(), rel=1e-3)
    assert np.nanmax(residual) == pytest.approx(-np.nanmin(residual))
    inside = np.abs(traces.measured - traces.predicted) <= traces.band
    share = 100.0 * inside[:, 0].mean()
    first = EffortSection().numbers(usual)["figures"][0]
    assert first["covered"] == f"{share:.1f}\u00a0% in the 95 % band" and not first["few"]


def test_a_score_without_bands_is_drawn_without(usual):
    score = usual.scores[0]
    bare = replace(score, traces=replace(score.traces, model_std=None, band=None))
    numbers = EffortSection().numbers(replace(usual, scores=(bare,), fitted=()))
    assert not numbers["bands"] and numbers["figures"][0]["bands"] == []
    assert "effort-bands" not in EffortSection().show(numbers)


def test_the_box_takes_the_bands_away(browse, usual):
    page = rendered_only(usual, "effort")
    choose = (
        "const box = document.getElementById('effort-bands');"
        "box.checked = false; box.dispatchEvent(new Event('change'));"
    )
    shown, hidden = browse(page), browse(page, choose)
    assert shown.console == () and hidden.console == () and hidden.errors == []
    areas = '<path class="js-fill"'
    counts = [
        seen.dom.split('<section id="effort"')[1].split("</section>")[0].count(areas)
        for seen in (shown, hidden)
    ]
    assert counts == [6, 0]
    assert shown.drawn == hidden.drawn == 2


def test_an_outline_is_closed_between_jumps_of_time():
    t = np.concatenate([np.arange(500) * 0.01, 20.0 + np.arange(500) * 0.01])
    x, y = outline(t, -np.ones(1000), np.ones(1000), 100)
    assert len(x) == len(y) <= 104
    pause = np.flatnonzero(np.isnan(x))
    assert len(pause) == 1 and np.isnan(y[pause[0]])
    for part in np.split(x, pause):
        part = part[np.isfinite(part)]
        assert part[0] == part[-1] and np.ptp(part) < 6.0
    assert np.array_equal(np.unique(y[np.isfinite(y)]), [-1.0, 1.0])


def test_the_table_shows_the_share_from_data(usual):
    table = [row for row in parameter_rows(usual.identified) if row.status != "not identifiable"]
    assert [row.from_data_percent for row in table[:2]] == [93.0, 93.0]
    assert table[-1].from_data_percent == 12.5 and table[-1].status == "from the prior"
    section = ParametersSection()
    text = section.show(section.numbers(usual))
    assert "From data" in text and "12.5\u00a0%" in text and "1 from the prior." in text
    assert "1 from the prior: offset.shoulder" in printed(usual)
    told = list(csv.DictReader(io.StringIO(parameters_csv(usual.identified))))
    assert told[-2]["from_data_percent"] == "12.5" and told[-2]["status"] == "from the prior"


def test_without_a_prior_there_is_no_share(usual):
    content = with_estimate(usual, learned=None, standard=None)
    section = ParametersSection()
    assert "From data" not in section.show(section.numbers(content))
    assert all(row.from_data_percent is None for row in parameter_rows(content.identified))
    assert "prior" not in printed(content)
    assert BodiesSection().numbers(content) is None


def test_bodies_have_masses_centres_and_intervals(usual):
    section = BodiesSection()
    table = section.numbers(usual)["tables"][0]
    first, second, total = (row.cells for row in table.rows)
    assert first[:3] == ("link of shoulder", "2.000 ± 0.079", "2.00")
    assert first[3].startswith("0.200 ± ") and first[4] == "0.0200, 0.0200, 0.0200"
    assert first[5] == "90.0\u00a0%" and float(first[6]) == pytest.approx(1.0)
    assert second[5] == "81.5\u00a0%"
    assert total[:3] == ("all links", "4.00 ± 0.11", "4.00")
    rows, _, foot = section.show(section.numbers(usual)).partition("<tfoot>")
    assert "link of elbow" in rows and "all links" in foot and "all links" not in rows


def test_the_centre_s_interval_is_that_of_draws(usual):
    link = next(identified_links(usual.identified))
    drawn = np.random.default_rng(0).multivariate_normal(
        link.inertia.ten[:4], link.covariance[:4, :4], 100_000
    )
    wanted = (drawn[:, 1:] / drawn[:, :1]).std(axis=0)
    assert np.allclose(link.com_std, wanted, rtol=0.02)


def test_the_margin_is_one_at_the_prior_and_below_zero_beyond_what_can_be(usual):
    prior = Inertia.about_com(2.0, [0.2, 0.0, 0.1], np.diag([0.02, 0.03, 0.025]))
    assert margin(prior, prior) == pytest.approx(1.0)
    half = Inertia.from_ten(0.5 * prior.ten)
    assert margin(half, prior) == pytest.approx(0.5)
    impossible = Inertia.about_com(2.0, [0.2, 0.0, 0.1], np.diag([0.02, 0.03, 0.06]))
    assert margin(impossible, prior) < 0.0
    standard = usual.identified.estimate.standard
    values = standard.parameters.values.copy()
    values[6] += 1.0
    broken = replace(standard, parameters=replace_values(standard.parameters, values))
    content = with_estimate(usual, standard=broken)
    assert (
        BodiesSection()
        .numbers(content)["tables"][0]
        .rows[0]
        .cells[6]
        .endswith("not physically consistent")
    )


def replace_values(parameters, values):
    return type(parameters)(parameters.names, parameters.units, values)


def test_a_massless_link_has_no_centre(usual):
    standard = usual.identified.estimate.standard
    values = standard.parameters.values.copy()
    values[:10] = 0.0
    broken = replace(standard, parameters=replace_values(standard.parameters, values))
    content = with_estimate(usual, standard=broken)
    assert BodiesSection().numbers(content)["tables"][0].rows[0].cells[3] == "–"


def test_one_run_more_does_not_break_the_budget(usual):
    scores = usual.scores * 12
    assert len(render(replace(usual, scores=scores)).encode()) <= 8 * 2**20


def test_what_a_bound_holds_has_no_interval(usual):
    names = usual.identified.estimate.parameters.names
    held = next(name for name in names if name.startswith("viscous."))
    values = usual.identified.estimate.parameters.values.copy()
    values[names.index(held)] = 3e-12
    parameters = replace_values(usual.identified.estimate.parameters, values)
    content = with_estimate(usual, parameters=parameters, at_bound=(held, names[0]))
    row = next(row for row in parameter_rows(content.identified) if row.name == held)
    assert (row.status, row.value) == ("at a bound", 0.0)
    empty = ("std", "lower95", "upper95", "relative_std_percent", "from_data_percent")
    assert [getattr(row, name) for name in empty] == [None] * 5
    assert parameter_rows(content.identified)[0].value == values[0]
    section = ParametersSection()
    html = section.show(section.numbers(content))
    assert ", 2 at a bound, " in html and html.count("at a bound</span>") == 2
    assert f"2 at a bound: {names[0]}, {held}" in printed(content)
    told = list(csv.DictReader(io.StringIO(parameters_csv(content.identified))))
    line = next(one for one in told if one["name"] == held)
    assert line["status"] == "at a bound" and line["value"] == "0.0"
    assert all(line[column] == "" for column in empty)
    assert "at a bound" not in printed(usual)


def test_a_bound_of_the_user_keeps_its_value(usual):
    model = usual.identified.model
    held = next(name for name in model.names if name.startswith("viscous."))
    names = usual.identified.estimate.parameters.names
    far = usual.identified.estimate.parameters.values.copy()
    far[names.index(held)] = 4.0
    parameters = replace_values(usual.identified.estimate.parameters, far)
    content = with_estimate(usual, parameters=parameters, at_bound=(held,))
    row = next(row for row in parameter_rows(content.identified) if row.name == held)
    assert row.value == 4.0 and row.status == "at a bound"


def test_a_band_that_holds_too_few_is_marked(browse, usual):
    score = usual.scores[0]
    narrow = replace(score.traces, band=score.traces.band * [0.02, 1.0])
    content = replace(usual, scores=(replace(score, traces=narrow),), fitted=(), diagnosis=None)
    numbers = EffortSection().numbers(content)
    assert [figure["few"] for figure in numbers["figures"]] == [True, False]
    assert "the model is incomplete there" in EffortSection().show(numbers)
    assert "the model is incomplete there" not in EffortSection().show(
        EffortSection().numbers(usual)
    )
    seen = browse(rendered_only(content, "effort"))
    assert seen.errors == [] and seen.dom.count('<span class="few">') == 1


def test_a_joint_without_samples_has_no_band(browse, usual):
    sigma = np.array([np.nan, 0.2])
    score = usual.scores[0]
    traces = replace(score.traces, band=score.traces.band * [np.nan, 1.0])
    content = with_estimate(usual, sigma=sigma, n_samples=np.array([0.0, 4200.0]))
    content = replace(content, scores=(replace(score, traces=traces),), fitted=(), diagnosis=None)
    still, moved = EffortSection().numbers(content)["figures"]
    assert still["bands"] == [] and still["covered"] == "" and not still["few"]
    assert len(moved["bands"]) == 3 and moved["covered"]
    seen = browse(rendered_only(content, "effort"))
    assert seen.errors == [] and seen.drawn == 2
