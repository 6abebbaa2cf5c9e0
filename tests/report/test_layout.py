"""All pages on a screen and on a phone, in light and in dark: overflow, contrast, keyboard.

`proofs/product/pages.py` has every page in every view, and on paper.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from browser import Rendered, Tab
from report.conftest import friction, identified, nasty_content, rendered_only, robot
from report.pages import PAGES, pages_of, unreached, wrong_on_paper, wrong_on_screen
from report.test_page import OF_ALL, own_html
from steelyard.identify.comparison.estimators_page import ComparisonContent
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.report.page import TEMPLATES, page_of

pytestmark = pytest.mark.slow

VIEWS = ((420, True), (1400, False))
"""Widths of the window and whether it is dark; the proof has all pairs."""


@pytest.fixture(scope="module")
def pages(usual: ReportContent, compared: ComparisonContent) -> dict[str, str]:
    """All of them; strange names are those of short runs, which a browser draws sooner."""
    return pages_of(usual, compared, nasty_content(samples=1_500))


@pytest.fixture
def shown(
    browser: Tab, pages: dict[str, str], name: str, tmp_path_factory: pytest.TempPathFactory
) -> Tab:
    """The browser with a page, loaded unless the test before has looked at it."""
    file = tmp_path_factory.getbasetemp() / f"layout of {name}.html"
    if browser.run("location.href") != file.as_uri():
        file.write_text(pages[name], encoding="utf-8")
        browser.show(*VIEWS[0])
        browser.open(file)
    return browser


def opened(browser: Tab, page: str, folder: Path, width: int = 1400) -> Tab:
    file = folder / "page.html"
    file.write_text(page, encoding="utf-8")
    browser.show(width)
    browser.open(file)
    return browser


@pytest.mark.parametrize("name", PAGES, scope="module")
def test_every_page_fits_is_readable_and_reached_by_the_keyboard(shown: Tab, name: str) -> None:
    assert wrong_on_screen(shown, VIEWS) == []
    joints = {"identification": 2, "strange names": 10}.get(name)
    if joints:
        seen = Rendered(shown.run("document.documentElement.outerHTML"), tuple(shown.console))
        assert seen.errors == [] and seen.drawn == joints
        assert [one.name for one in OF_ALL if f'<section id="{one.name}"' not in seen.dom] == []


@pytest.mark.parametrize(
    ("change", "check", "said"),
    [
        ("<p style='width:1500px'>wide</p>", "overflow()", "wide"),
        ("<p style='color:#8a8a8a;background:#fff'>pale</p>", "contrast()", "pale"),
        ("<p style='opacity:.4'>faint</p>", "contrast()", "faint"),
    ],
)
def test_the_checks_see_what_is_wrong(
    browser: Tab, tmp_path: Path, change: str, check: str, said: str
) -> None:
    page = page_of("nothing", "arm", ())
    tab = opened(browser, page, tmp_path)
    assert tab.run(check) == []
    tab = opened(browser, page.replace("</main>", change + "</main>"), tmp_path)
    assert said in str(tab.run(check))


def test_the_checks_see_what_the_keyboard_does_not_reach(browser: Tab, tmp_path: Path) -> None:
    more = "<a href='#x' style='outline:0'>no outline</a><select style='outline:0'></select>"
    trap = "<a href='#y' onfocus='this.blur()'>never</a></main>"
    page = page_of("nothing", "arm", ()).replace("</main>", more + trap)
    assert len(unreached(opened(browser, page, tmp_path))) == 3


def test_errors_of_a_page_are_seen(browser: Tab, tmp_path: Path) -> None:
    page = page_of("nothing", "arm", ())
    wrong = page.replace("</body>", "<script>missing.name</script></body>")
    assert "missing is not defined" in str(opened(browser, wrong, tmp_path).console)


TABLE = """<div class="box"><table><thead>
<tr><th scope="col">Name</th><th scope="col">Size</th></tr></thead><tbody>
<tr><th scope="row">b</th><td>20.0\u00a0mm</td></tr>
<tr><th scope="row">c 10</th><td>–</td></tr><tr class="follows"><td colspan="2">of c</td></tr>
<tr><th scope="row">a</th><td>1\u00a0200\u00a0mm</td></tr>
<tr><th scope="row">c 9</th><td>-1.5e-3 m</td></tr>
<tr><th scope="row">d</th><td>0.5 m</td></tr></tbody>
<tfoot><tr><th scope="row">all</th><td>9 m</td></tr></tfoot></table></div></main>"""


def test_headings_sort_numbers_as_numbers_with_their_units(browser: Tab, tmp_path: Path) -> None:
    page = page_of("nothing", "arm", ()).replace("</main>", TABLE)
    tab = opened(browser, page, tmp_path)
    rows = "[...document.querySelectorAll('tr')].map(row => row.cells[0].textContent)"
    sort = "document.querySelector('[aria-sort]')?.ariaSort ?? null"
    as_written = ["Name", "b", "c 10", "of c", "a", "c 9", "d", "all"]
    assert tab.run(rows) == as_written and tab.run(sort) is None
    tab.run("document.querySelectorAll('.sort')[1].focus()")
    tab.press("Enter")
    assert tab.run(rows) == ["Name", "c 9", "b", "d", "a", "c 10", "of c", "all"]
    assert tab.run(sort) == "ascending"
    tab.press("Enter")
    assert tab.run(rows) == ["Name", "a", "d", "b", "c 9", "c 10", "of c", "all"]
    assert tab.run(sort) == "descending"
    tab.press("Enter")
    assert tab.run(rows) == as_written and tab.run(sort) is None
    tab.run("document.querySelectorAll('.sort')[0].click()")
    assert tab.run(rows) == ["Name", "a", "b", "c 9", "c 10", "of c", "d", "all"]


def test_figures_and_page_follow_the_system_and_the_button(
    browser: Tab, pages: dict[str, str], tmp_path: Path
) -> None:
    tab = opened(browser, pages["comparison"], tmp_path)
    tick = "getComputedStyle(document.querySelector('.xtick text')).fill"
    ground = "getComputedStyle(document.body).backgroundColor"
    light = tab.run(tick), tab.run(ground)
    tab.show(1400, dark=True)
    tab.run("drawn()")
    dark = tab.run(tick), tab.run(ground)
    assert light[0] != dark[0] and light[1] != dark[1]
    for seen in (light, dark):
        tab.run("document.getElementById('theme').click()")
        tab.run("drawn()")
        assert (tab.run(tick), tab.run(ground)) == seen


def test_a_link_opens_the_folded_section_that_it_leads_to(
    browser: Tab, pages: dict[str, str], tmp_path: Path
) -> None:
    tab = opened(browser, pages["check"], tmp_path)
    fold = "document.querySelector('#notes > details').open"
    assert tab.run(fold) is False
    tab.run("document.querySelector('nav a[href=\"#notes\"]').click()")
    tab.run("new Promise(done => setTimeout(done, 0))")
    assert tab.run(fold) is True


FIGURES = "[...document.querySelectorAll('.plot, .picture')]"
UNDRAWN = f"{FIGURES}.filter(one => one.checkVisibility() && !one.querySelector('.main-svg'))"


def listening(page: str, event: str, script: str) -> str:
    """A page that keeps a value of the moment after its own scripts have handled an event."""
    keep = f"addEventListener('{event}', () => {{ window.kept = {script}; }})"
    return page.replace("</body>", f"<script>{keep}</script></body>")


FLAT = ("effort", "residuals", "check")
"""Sections with figures, large, small and folded, none of them in space."""


def test_figures_in_the_window_are_drawn_when_the_page_is_loaded(
    browser: Tab, usual: ReportContent, tmp_path: Path
) -> None:
    browser.show(1400, height=30_000)
    file = tmp_path / "page.html"
    file.write_text(listening(rendered_only(usual, *FLAT), "load", f"{UNDRAWN}.length"))
    browser.open(file)
    assert browser.run(f"{FIGURES}.length") > 5 and browser.run("kept") == 0


def test_all_figures_are_drawn_on_paper_as_wide_as_it(
    browser: Tab, usual: ReportContent, tmp_path: Path
) -> None:
    widths = f"{FIGURES}.map(one => one.querySelector('.main-svg')?.clientWidth)"
    page = rendered_only(usual, *FLAT)
    page = listening(page, "beforeprint", f"[{UNDRAWN}.length, {widths}]")
    tab = opened(browser, page, tmp_path)
    before = tab.run(widths)
    tab.send("Page.printToPDF")
    undrawn, printed = tab.run("kept")
    assert undrawn == 0 and set(printed) == {680, 218}
    tab.run("drawn()")
    after = tab.run(widths)
    assert [new for new, old in zip(after, before, strict=True) if old] == [*filter(None, before)]


def test_figures_out_of_the_window_have_light_colours_on_paper(
    browser: Tab, usual: ReportContent, tmp_path: Path
) -> None:
    browser.show(1400, dark=True, height=300)
    grids = f"{FIGURES}.map(one => one.layout.xaxis.gridcolor)"
    expected = "getComputedStyle(document.documentElement).getPropertyValue('--grid').trim()"
    page = rendered_only(usual, "effort")
    file = tmp_path / "page.html"
    file.write_text(listening(page, "beforeprint", f"[{expected}, {grids}]"))
    browser.open(file)
    dark = browser.run(expected)
    assert browser.run(grids) == [dark] * 2
    browser.run("dispatchEvent(new Event('beforeprint'))")
    light, printed = browser.run("kept")
    assert light != dark and printed == [light] * 2


def test_figures_of_another_run_are_drawn_one_by_one_from_the_window_on(
    browser: Tab, usual: ReportContent, tmp_path: Path
) -> None:
    """Below the figures, the last one is the nearest; all others are drawn afterwards."""
    browser.show(420, height=200)
    file = tmp_path / "page.html"
    spacer = "<div style='height:2000px'></div></main>"
    file.write_text(rendered_only(usual, "effort").replace("</main>", spacer))
    browser.open(file)
    runs = f"{FIGURES}.map(one => one.dataset.run)"
    assert browser.run(runs) == ["0", "0"]
    change = "menu.value = '1'; menu.dispatchEvent(new Event('change'))"
    menu = "const menu = document.getElementById('effort-run')"
    browser.run("scrollTo(0, document.body.scrollHeight)")
    assert browser.run(f"{{ {menu}; {change}; {runs} }}") == ["0", "1"]
    browser.run("new Promise(done => setTimeout(done, 0))")
    assert browser.run(runs) == ["1", "1"]


def test_tables_fit_on_paper_and_their_headings_do_not_overlap(
    browser: Tab, usual: ReportContent, tmp_path: Path
) -> None:
    page = rendered_only(usual, "parameters", "residuals")
    assert wrong_on_paper(opened(browser, page, tmp_path)) == []


@pytest.mark.parametrize("width", [1400, 1200])
def test_the_table_of_parameters_fits_on_a_screen(browser: Tab, width: int, tmp_path: Path) -> None:
    joints = ("shoulder_pan_joint", "shoulder_lift_joint")
    content = ReportContent("arm", "arm", identified=identified(robot(joints)))
    tab = opened(browser, rendered_only(content, "parameters"), tmp_path, width)
    box = "document.querySelector('.parameters').parentElement"
    assert "From data" in tab.run(f"{box}.textContent")
    assert tab.run(f"{box}.scrollWidth - {box}.clientWidth") == 0


def test_the_tables_of_bodies_and_data_quality_fit_on_a_screen(
    browser: Tab, tmp_path: Path
) -> None:
    joints = tuple(f"panda_joint{k}" for k in range(1, 8))
    each = "1e-06 2e-07 1e-06 1e-05 1e-07 1e-06 1e-06"
    quality = (
        ("rows", "20544 of 20544 used"),
        ("dropped", "none"),
        ("corrected", "10 outliers interpolated, 1226 repeated rows interpolated"),
        ("duration", "21.00 s"),
        ("clock", "1.022 ms mean step, 0.7 to 8.81 ms, jitter 0.19 ms"),
        ("gaps", "none"),
        ("uniform clock", "1000 Hz"),
        ("position resolution", each),
        ("effort resolution", each),
        ("maximum speed", "1.8 1.5 1.8 1.2 1.5 1.8 1.7"),
    )
    model = identified(robot(joints))
    runs = (("panda_gaz2019_trajectory1", quality),)
    content = ReportContent("arm", "arm", identified=model, qualities=runs)
    tab = opened(browser, rendered_only(content, "bodies", "quality"), tmp_path)
    tab.run("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    boxes = "[...document.querySelectorAll('.box')]"
    assert tab.run(f"{boxes}.map(one => one.scrollWidth - one.clientWidth)") == [0, 0]


def test_friction_laws_fit_on_a_phone(browser: Tab, usual: ReportContent, tmp_path: Path) -> None:
    laws = "coulomb + maxwell_slip (lengths 0.001, 0.004, 0.02, 0.1, relaxing) + viscous"
    content = replace(usual, friction=friction(laws))
    tab = opened(browser, rendered_only(content, "friction"), tmp_path, 420)
    box = "document.querySelector('#friction .box')"
    assert tab.run(f"{box}.scrollWidth - {box}.clientWidth") == 0
    headings = tab.run(f"[...{box}.querySelectorAll('thead th')].map(one => one.textContent)")
    assert headings[1:4] == ["Error", "Improvement", "Standard error"]
    assert tab.run(f"{box}.querySelector('tbody th').clientWidth / {box}.clientWidth") > 0.9


@pytest.mark.parametrize("name", PAGES)
def test_notes_and_settings_are_last_and_folded(pages: dict[str, str], name: str) -> None:
    last = own_html(pages[name]).rpartition("<section")[2]
    assert '<details class="fold">' in last and "Notes" in last


@pytest.mark.parametrize("name", PAGES)
def test_a_page_has_landmarks_one_heading_and_scopes(pages: dict[str, str], name: str) -> None:
    page = own_html(pages[name])
    for landmark in ("<header", '<nav aria-label="Contents">', '<main id="content"', "<footer"):
        assert page.count(landmark) == 1
    assert page.count("<h1>") == 1 and '<a class="skip" href="#content">' in page
    headings = re.findall(r"<th\b[^>]*>", page)
    assert headings and all('scope="' in heading for heading in headings)


@pytest.mark.parametrize("name", PAGES)
def test_colours_of_figures_are_those_of_the_style_sheet(pages: dict[str, str], name: str) -> None:
    style = (TEMPLATES / "style.css").read_text(encoding="utf-8")
    figures = re.findall(r'<script type="application/json"[^>]*>(.*?)</script>', pages[name])
    assert figures
    words = {word for figure in figures for word in strings(json.loads(figure))}
    assert not [word for word in words if re.fullmatch(r"#[0-9a-f]{3,8}|rgba?\(.*", word)]
    named = {word for word in words if word.startswith("--")}
    assert all(f"{word}: " in style for word in named)


def strings(value: object) -> Iterator[str]:
    """All texts of a JSON value."""
    if isinstance(value, str):
        yield value
    for part in (
        value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    ):
        yield from strings(part)
