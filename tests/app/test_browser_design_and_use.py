"""Design and use in a real browser: by clicks, and as a screen reader finds the pages."""

from pathlib import Path

import pytest

from app.guided import Visitor, serious_faults, serving, visiting
from steelyard.robot.file.toml_schema import tomllib

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("browser")]


def faults(visitor: Visitor, step: str) -> list[str]:
    """Serious faults of accessibility, and pages that are wider than the window."""
    found = []
    for width in (1400, 420):
        for colours in ("light", "dark"):
            visitor.page.set_viewport_size({"width": width, "height": 900})
            visitor.page.emulate_media(color_scheme=colours)
            visitor.step(step)
            visitor.idle()
            found += [f"{width}, {colours}: {one}" for one in serious_faults(visitor)]
            if (wide := visitor.page.evaluate("document.documentElement.scrollWidth")) > width:
                found.append(f"{wide} px wide of {width}")
    visitor.page.set_viewport_size({"width": 1400, "height": 900})
    return found


def test_a_motion_is_designed_and_rehearsed(tmp_path: Path, arm: Path) -> None:
    with serving(tmp_path / "workspace") as server, visiting(server.address) as visitor:
        page = visitor.page
        robot = tmp_path / "arm"
        robot.mkdir()
        (robot / "arm.urdf").write_bytes((arm / "arm.urdf").read_bytes())
        for name in ("LICENSE", "README.md"):
            (robot / name).write_text("words")
        page.set_input_files("#folder-robot", str(robot))
        visitor.see("#message.calm:has-text('1 file taken, 2 skipped')")
        visitor.see(".space3d[data-drawn]")
        visitor.idle()
        page.locator("#dh summary").click()
        page.fill("[name=name]", "typed")
        page.focus("[name=rows]")
        page.evaluate("document.activeElement.setSelectionRange(2, 4)")
        version = page.get_attribute("#step", "data-version")
        file = server.folder / "robot.toml"
        file.write_text(file.read_text() + "\n# by an editor\n")
        visitor.see(f"#step:not([data-version='{version}'])")
        visitor.idle()
        assert page.input_value("[name=name]") == "typed"
        assert page.evaluate("document.activeElement.name") == "rows"
        assert page.evaluate("document.activeElement.selectionEnd") == 4
        visitor.step("Design")
        visitor.see(".space3d[data-drawn]")
        page.fill("[name=floor]", "0.05")
        visitor.click("Write into the robot file")
        visitor.idle()
        written = tomllib.loads(file.read_text())["excitation"]
        assert written["workspace"]["floor"] == 0.05
        assert page.input_value("[name=floor]") == "0.05"
        page.fill("[name=floor]", "0.06")
        page.fill("[name=share]", "7")
        page.locator("form[data-post='/design/room']").evaluate("form => form.noValidate = true")
        visitor.click("Write into the robot file")
        visitor.see("#message:has-text('share')")
        page.fill("[name=share]", "0.9")
        page.fill("[name=keep_out]", "0.3 0.5 -0.8 -0.6 0 0.3")
        page.fill("[name=budget]", "4")
        visitor.click("Design the motion")
        visitor.see("[data-play]")
        visitor.idle()
        written = tomllib.loads(file.read_text())["excitation"]
        assert written["workspace"]["floor"] == 0.06 and written["limits"]["share"] == 0.9
        assert written["workspace"]["keep_out"] == [
            {"x": [0.3, 0.5], "y": [-0.8, -0.6], "z": [0, 0.3]}
        ]
        visitor.click("Play")
        page.wait_for_selector("[data-now]:not(:text-is('0.0 s'))")
        visitor.click("Rehearse")
        visitor.see("text=Planted and identified values")
        visitor.idle()
        assert page.locator("#planted tbody tr").count() == 25
        with page.expect_download() as got:
            page.click("a[href='/download/motions/motion-1/trajectory.csv']")
        assert got.value.suggested_filename == "trajectory.csv"
        assert faults(visitor, "Design") == []
        assert [one for one in visitor.wrong if "422" not in one] == []


def test_a_model_is_used_and_exported(tmp_path: Path, arm: Path) -> None:
    with serving(tmp_path / "workspace") as server, visiting(server.address) as visitor:
        page = visitor.page
        visitor.drop("robot", arm / "arm.urdf")
        visitor.see(".space3d[data-drawn]")
        visitor.step("Logs")
        visitor.drop("logs", arm / "a.csv", arm / "b.csv")
        visitor.see(".picture .main-svg")
        visitor.idle()
        visitor.step("Check")
        visitor.click("Check the logs")
        visitor.click("Next: identify", "link")
        visitor.click("Identify")
        visitor.see("iframe")
        visitor.idle()
        visitor.step("Use")
        visitor.drop("used-logs", arm / "b.csv")
        visitor.see("text=used-logs/b.csv")
        visitor.idle()
        page.select_option("#what", "contact")
        visitor.click("Evaluate")
        visitor.see("iframe[src='/report/reports/contact-1/report.html']")
        visitor.idle()
        assert "contacts" in page.frame_locator("iframe").locator("h1").inner_text()
        page.select_option("#to", "ros2")
        visitor.click("Export")
        visitor.see("text=Written: exports/model-1-ros2")
        visitor.idle()
        with page.expect_download() as got:
            page.click("a[href='/download/exports/model-1-ros2']")
        assert got.value.suggested_filename == "model-1-ros2.zip"
        assert faults(visitor, "Use") == []
        assert visitor.wrong == []
