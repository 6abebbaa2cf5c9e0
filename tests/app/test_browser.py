"""The app in a real browser: by clicks, by keys, in two tabs, and as a screen reader finds it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from typer.testing import CliRunner

from app.guided import (
    Server,
    Visitor,
    another_tab,
    serious_faults,
    serving,
    visiting,
)
from steelyard.cli.app import app
from steelyard.robot.file.toml_schema import tomllib

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("browser")]

STEPS = ("Robot", "Logs", "Check", "Identify")
EVIL = "<script>document.body.dataset.errors='ran'</script>"


@pytest.fixture
def started(tmp_path: Path) -> Iterator[tuple[Server, Visitor]]:
    """An app on an empty workspace, and a browser at it."""
    with serving(tmp_path / "workspace") as server, visiting(server.address) as visitor:
        yield server, visitor
        assert visitor.wrong == []


def logs_read(visitor: Visitor, arm: Path) -> None:
    """Drop the robot and both logs."""
    visitor.drop("robot", arm / "arm.urdf")
    visitor.see(".space3d[data-drawn]")
    visitor.step("Logs")
    visitor.drop("logs", arm / "a.csv", arm / "b.csv")
    visitor.see(".picture .main-svg")
    visitor.idle()


def signals(server: Server) -> dict[str, Any]:
    found: dict[str, Any] = tomllib.loads((server.folder / "robot.toml").read_text())["signals"]
    return found


def test_from_a_model_file_and_two_logs_to_a_model(
    started: tuple[Server, Visitor], arm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    server, visitor = started
    logs_read(visitor, arm)
    visitor.click("Next: check", "link")
    visitor.click("Check the logs")
    visitor.click("Next: identify", "link")
    visitor.click("Identify")
    visitor.see("iframe")
    visitor.idle()
    frame = visitor.page.frame_locator("iframe")
    assert "identified dynamics" in frame.locator("h1").inner_text()
    assert serious_faults(visitor) == []
    monkeypatch.chdir(server.folder)
    for words in (
        ["init", "robot/arm.urdf", "logs/a.csv", "logs/b.csv", "-o", "same.toml", "--no-input"],
        ["identify", "robot.toml", "logs/a.csv", "--validate", "logs/b.csv", "-o", "same"],
    ):
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0, done.output
    assert Path("same.toml").read_text() == Path("robot.toml").read_text()
    assert Path("same/model.json").read_bytes() == Path("models/model-1/model.json").read_bytes()


def test_swapped_columns_and_degrees_are_put_right_by_clicks(
    started: tuple[Server, Visitor], arm: Path, tmp_path: Path
) -> None:
    server, visitor = started
    bad = tmp_path / "bad"
    bad.mkdir()
    (bad / "arm.urdf").write_bytes((arm / "arm.urdf").read_bytes())
    for name in ("a.csv", "b.csv"):
        log = pl.read_csv(arm / name)
        q1, q2 = log["q1"], log["q2"]
        log.with_columns(q1=q2, q2=q1, q3=log["q3"].degrees()).write_csv(bad / name)
    logs_read(visitor, bad)
    visitor.step("Check")
    visitor.click("Check the logs")
    visitor.idle()
    while visitor.page.get_by_role("button", name="Accept").count():
        visitor.page.get_by_role("button", name="Accept").first.click()
        visitor.idle()
    assert signals(server)["position"] == ["q2", "q1", "q3"]
    assert signals(server)["position_unit"] in (["rad", "rad", "deg"], "deg")
    visitor.see("text=Next: identify")


def test_two_tabs_agree_and_so_does_an_editor(started: tuple[Server, Visitor], arm: Path) -> None:
    server, first = started
    logs_read(first, arm)
    second = another_tab(first.page.context, f"{server.origin}/logs")
    first.page.select_option("#sign-1", "-1")
    second.page.wait_for_selector("#sign-1 option[value='-1'][selected]", state="attached")
    assert signals(server)["position_sign"] == [1, -1, 1]
    second.click("Undo the last change of the robot file")
    first.page.wait_for_selector("#sign-1 option[value='1'][selected]", state="attached")
    assert "position_sign" not in signals(server)
    robot = server.folder / "robot.toml"
    robot.write_text(robot.read_text().replace('"q{}"', '["q3", "q2", "q1"]'))
    for tab in (first, second):
        tab.page.wait_for_selector("#position-0 option[selected]:text-is('q3')", state="attached")
        tab.idle()
    assert second.wrong == []


def test_what_stays_the_same_is_not_replaced(started: tuple[Server, Visitor], arm: Path) -> None:
    server, visitor = started
    logs_read(visitor, arm)
    page = visitor.page
    kept = ("#files-logs", "a[href='/check']", "button[value='logs/b.csv']", "#sign-1", ".picture")
    page.evaluate("all => all.forEach(x => { document.querySelector(x).marked = true; })", kept)
    page.locator("#columns ~ form th .sort").first.click()
    page.evaluate("document.querySelector('#unit-2').value = 'deg'")  # not sent
    robot = server.folder / "robot.toml"
    robot.write_text(robot.read_text().replace('"q{}"', '["q3", "q2", "q1"]'))
    page.wait_for_selector("#position-0 option[selected]:text-is('q3')", state="attached")
    visitor.idle()
    assert page.input_value("#position-0") == "q3" and page.input_value("#unit-2") == "deg"
    page.locator("[data-row='logs/b.csv'] select").focus()
    (server.folder / "logs" / "aa.csv").write_bytes((arm / "a.csv").read_bytes())
    visitor.see("[data-row='logs/aa.csv']")
    visitor.idle()
    assert page.evaluate("document.activeElement.closest('li').dataset.row") == "logs/b.csv"
    lost = "all => all.filter(x => !document.querySelector(x).marked)"
    assert page.evaluate(lost, kept) == [".picture"]  # drawn from other data
    assert page.locator("#columns ~ form th .sort").count() == 6
    assert visitor.page.locator("#columns ~ form tbody th").all_inner_texts() == [
        "joint1",
        "joint2",
        "joint3",
    ]


def test_all_by_keyboard(started: tuple[Server, Visitor], arm: Path) -> None:
    from playwright.sync_api import TimeoutError

    server, visitor = started
    page = visitor.page

    def focus(selector: str) -> None:
        """Press the tabulator until something has the focus, from the start of the page."""
        page.evaluate("document.activeElement.blur(); scrollTo(0, 0)")
        page.locator(".skip").focus()
        for _ in range(120):
            if page.evaluate("s => document.activeElement.matches(s)", selector):
                return
            page.keyboard.press("Tab")
        raise AssertionError(f"no key leads to {selector}")

    def choose(kind: str, *files: Path) -> None:
        visitor.idle()
        for last in (False, False, True):  # a browser short of time may not take a key as a user's
            focus(f"#files-{kind}")
            try:
                with page.expect_file_chooser(timeout=None if last else 20_000.0) as chooser:
                    page.keyboard.press("Space")
                break
            except TimeoutError:
                if last:
                    raise
        chooser.value.set_files([str(file) for file in files])

    choose("robot", arm / "arm.urdf")
    visitor.see(".space3d[data-drawn]")
    visitor.idle()
    focus("#joint-1")
    before = page.input_value("#joint-1")
    page.keyboard.press("ArrowRight")
    assert page.input_value("#joint-1") != before
    focus(".space3d")
    page.keyboard.press("ArrowLeft")
    focus("a[href='/logs']")
    page.keyboard.press("Enter")
    page.wait_for_url("**/logs")
    choose("logs", arm / "a.csv", arm / "b.csv")
    visitor.see(".picture .main-svg")
    visitor.idle()
    focus("#unit-0")
    page.keyboard.press("ArrowDown")
    visitor.idle()
    page.wait_for_selector("#unit-0 option[selected]:text-is('deg')", state="attached")
    visitor.idle()
    assert page.evaluate("document.activeElement.id") == "unit-0"
    focus(".undo button")
    page.keyboard.press("Enter")
    page.wait_for_selector("#unit-0 option[selected]:text-is('rad')", state="attached")
    visitor.idle()
    focus("a[href='/check']")
    page.keyboard.press("Enter")
    page.wait_for_url("**/check")
    focus("form[data-post='/check/run'] button")
    page.keyboard.press("Enter")
    visitor.see("a[href='/identify'].main")
    visitor.idle()
    focus("a[href='/identify'].main")
    page.keyboard.press("Enter")
    page.wait_for_url("**/identify")
    focus("form[data-post='/identify/run'] button")
    page.keyboard.press("Enter")
    visitor.see("iframe")
    visitor.idle()
    assert (server.folder / "models" / "model-1" / "model.json").exists()


def test_no_serious_fault_of_accessibility_and_nothing_overflows(
    started: tuple[Server, Visitor], arm: Path
) -> None:
    _, visitor = started
    logs_read(visitor, arm)
    visitor.page.select_option("#position-0", "q2")
    visitor.idle()
    visitor.page.select_option("#position-1", "q1")
    visitor.idle()
    visitor.step("Check")
    visitor.click("Check the logs")
    visitor.see("text=Go on all the same")
    visitor.idle()
    found = []
    for width in (1400, 420):
        for colours in ("light", "dark"):
            visitor.page.set_viewport_size({"width": width, "height": 900})
            visitor.page.emulate_media(color_scheme=colours)
            for step in STEPS:
                visitor.step(step)
                visitor.idle()
                found += [f"{step}, {width}, {colours}: {one}" for one in serious_faults(visitor)]
                if (wide := visitor.page.evaluate("document.documentElement.scrollWidth")) > width:
                    found.append(f"{step} is {wide} px wide of {width}")
    assert found == []


def test_a_joint_and_a_column_with_the_name_of_a_script_run_nothing(
    started: tuple[Server, Visitor], arm: Path, tmp_path: Path
) -> None:
    _, visitor = started
    named = EVIL.replace("<", "&lt;").replace(">", "&gt;").replace("'", "&apos;")
    (tmp_path / "evil.urdf").write_text(
        (arm / "arm.urdf").read_text().replace('"joint1"', f'"{named}"')
    )
    pl.read_csv(arm / "a.csv").rename({"q1": f"q1{EVIL}"}).write_csv(tmp_path / "a.csv")
    visitor.drop("robot", tmp_path / "evil.urdf")
    visitor.see(".space3d[data-drawn]")
    visitor.step("Logs")
    visitor.drop("logs", tmp_path / "a.csv")
    visitor.idle()
    for step in STEPS:
        visitor.step(step)
        visitor.idle()
        assert visitor.page.evaluate("document.body.dataset.errors || ''") == ""


def test_a_page_says_that_its_app_has_ended(tmp_path: Path) -> None:
    with serving(tmp_path / "workspace") as server, visiting(server.address) as visitor:
        visitor.see("#files-robot")
        server.kill()
        visitor.see("#message:has-text('The app does not answer')")
