"""The page in a real browser."""

import base64
import re
from dataclasses import replace

import numpy as np
import pytest

from report.conftest import rendered_only, run_score
from steelyard.identify.page.efforts_their_parts_and_residuals import EffortSection
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.identify.scores_and_model_report import SECTIONS, render
from steelyard.report.page_figures import thin

MEGABYTE = 1_000_000
ARCHIVE = '<script type="application/gzip" id="plotly">'

OTHERS = "reduction", "removals"
OF_ALL = [section for section in SECTIONS if section.name not in OTHERS]
"""Sections of the fixtures' contents; others are of `reduce` and of estimates from each log alone.
"""


def own_html(page: str) -> str:
    """The page without the archive of plotly.js."""
    return re.sub(ARCHIVE + "[^<]*", "", page)


@pytest.mark.parametrize("which", ["usual", "nasty"])
def test_the_whole_page_is_small(request, which):
    """`test_layout.py` has it drawn without an error."""
    page = render(request.getfixturevalue(which))
    assert len(page.encode()) <= 4 * MEGABYTE


def test_the_test_would_see_an_error_and_a_missing_plot(browse, usual):
    page = rendered_only(usual, "effort").replace("Plotly.react(plot,", "Plotly.react(nothing,")
    seen = browse(page)
    assert "nothing" in seen.errors[0]
    assert any("nothing" in line for line in seen.console)
    assert seen.drawn == 0


def test_the_menu_shows_another_run(browse, usual):
    choose = (
        "const menu = document.getElementById('effort-run');"
        "menu.value = '2'; menu.dispatchEvent(new Event('change'));"
    )
    seen = browse(rendered_only(usual, "effort"), choose)
    assert seen.drawn == 2 and seen.console == ()
    captions = re.findall(r'caption" data-joint="\d">([^<]*<span class="">[^<]*)<', seen.dom)
    assert [re.sub("<.*?>", "", one).replace("&nbsp;", " ") for one in captions] == [
        f"error {error} % of the effort used · 100 % in the 95 % band"
        for error in ("0.600 Nm: 3.0", "0.900 Nm: 3.0")
    ]


def test_the_network_is_neither_asked_nor_allowed(usual):
    page = own_html(render(usual))
    links = re.findall(r"""(?:src|href|action)\s*=\s*["']?([^"'\s>]*)""", page)
    assert len(links) == len(OF_ALL) + 2 and all(link.startswith(("#", "data:")) for link in links)
    assert "http:" not in page and "https:" not in page
    assert "default-src 'none'" in page
    assert page.count("url(") == 0 and "@import" not in page


def test_plotly_is_embedded_once_and_left_out_without_plots(usual):
    assert render(usual).count(ARCHIVE) == 1
    content = ReportContent("nothing", "arm", identified=usual.identified)
    bare = rendered_only(content, "verdict")
    assert ARCHIVE not in bare and len(bare) < 50_000
    assert "Not validated on unseen motion" in bare


@pytest.mark.slow
def test_names_of_strangers_stay_text(nasty):
    page = own_html(render(nasty))
    assert "<script>document.body" not in page
    assert '<b>"' not in page
    assert "&lt;script&gt;document.body.dataset.errors=&#39;ran&#39;" in page
    assert "{{7*7}}" in page and "49}" not in page


@pytest.mark.slow
def test_many_runs_and_joints_stay_small(usual):
    run = run_score("run", tuple(f"joint{k}" for k in range(10)), 2_000)
    many = replace(usual, scores=(), fitted=(run,) * 64)
    numbers = EffortSection().numbers(many)
    assert len(numbers["runs"]) + len(numbers["left_out"]) == 64 and numbers["left_out"]
    assert 200 <= numbers["points"] < 210
    assert len(render(many).encode()) <= 4 * MEGABYTE


def test_lines_hold_the_thinned_samples_in_single_precision(usual):
    figure = EffortSection().numbers(usual)["figures"][1]
    raw = base64.b64decode(figure["lines"][0]["y"]["bdata"])
    measured = usual.scores[0].traces.measured[:, 1]
    chosen = thin(measured, 2000)
    np.testing.assert_array_equal(np.frombuffer(raw, "<f4"), measured[chosen].astype("<f4"))
    assert len(chosen) <= 2000 < len(measured)
