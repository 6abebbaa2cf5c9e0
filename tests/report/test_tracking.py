"""The page about tracking: tables, pictures, JSON, terminal."""

import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from report.conftest import EVIL, robot
from steelyard.robot.robot import Frame, Robot
from steelyard.simulate.track import TrackedRun, Tracking
from steelyard.simulate.tracking_page import (
    TrackingComparison,
    headline,
    magnification,
    plane,
    tables,
)


def tracking_content(arm: Robot, *names: str) -> TrackingComparison:
    """Runs on a square in the x-z plane, errors of 4, 2, ... mrad and as many mm."""
    t = np.linspace(0.0, 4.0, 401)
    side = np.array([[0, 0, 0], [0.2, 0, 0], [0.2, 0, 0.2], [0, 0, 0.2], [0, 0, 0]], float)
    desired = np.column_stack([np.interp(t, range(5), axis) for axis in side.T])
    runs = []
    for k, name in enumerate(names or ("cascade", "cascade + feedforward")):
        size = 4e-3 / 2**k
        error = np.column_stack([size * np.sin(5.0 * t + j) for j in range(arm.n)])
        tool = desired + size * np.array([0.0, 1.0, 0.0])
        runs.append(TrackedRun(name, error, tool, np.full(len(t), size)))
    frame = Frame("tool", arm.n - 1, np.eye(3), np.zeros(3))
    found = Tracking(arm, frame, t, desired, tuple(runs))
    return TrackingComparison(arm.name, found, (("control", "cascade"),))


def printed(content: TrackingComparison) -> str:
    text = io.StringIO()
    content.show(Console(file=text, width=100))
    return text.getvalue()


def test_tables_have_errors_in_degrees_and_their_ratio() -> None:
    found = tracking_content(robot()).tracking
    assert found is not None
    rms, largest = tables(found)
    first = np.degrees(found.runs[0].rms[0])
    assert rms.rows[0].cells == ("shoulder", f"{first:.3f}", f"{first / 2:.4f} (0.50)", "°")
    assert rms.rows[-1].cells == ("tool (tool)", "4.00", "2.00 (0.50)", "mm")
    assert rms.rows[-1].total and rms.headings[1:3] == ("cascade", "cascade + feedforward")
    assert largest.caption == "Largest error"
    assert float(largest.rows[0].cells[1]) == pytest.approx(np.degrees(4e-3), rel=1e-2)
    assert "50.0 % of that without a model (mean), tool 2.00 instead of 4.00 mm" in headline(found)


def test_one_controller_has_no_ratio() -> None:
    content = tracking_content(robot(), "pid")
    found = content.tracking
    assert found is not None and headline(found) == "Tool: RMS 4.00 mm under pid"
    assert tables(found)[0].headings == ("Joint", "pid", "Unit")
    assert "In brackets" not in content.report()


@pytest.mark.parametrize("names", [(), ("pid",)])
def test_a_random_true_robot_is_in_the_headline(names: tuple[str, ...]) -> None:
    content = tracking_content(robot(), *names)
    assert content.tracking is not None
    assert "random" not in headline(content.tracking)
    content = replace(content, tracking=replace(content.tracking, random_truth=True))
    line, numbers = headline(content.tracking), content.to_dict()
    assert "random true parameters near the nominal ones" in line and "--truth" in line
    assert ("the model was identified from other logs" in line) == (not names)
    assert line in content.report().replace("\u00a0", " ")
    assert " ".join(printed(content).split()).startswith(line)
    assert numbers["headline"] == line and numbers["random_truth"]


def test_numbers_as_json() -> None:
    content = tracking_content(robot())
    told = content.to_dict()
    first, second = json.loads(json.dumps(told, allow_nan=False))["controllers"]
    assert second["name"] == "cascade + feedforward"
    assert [joint["ratio"] for joint in second["joints"]] == pytest.approx([0.5, 0.5])
    assert second["joints"][1]["unit"] == "rad" and second["joints"][1]["name"] == "elbow"
    assert first["tool"] == {"frame": "tool", "unit": "m", "rms": 4e-3, "largest": 4e-3}


def test_the_path_is_seen_where_it_is_wide_and_deviations_are_enlarged() -> None:
    found = tracking_content(robot()).tracking
    assert found is not None and plane(found) == (0, 2)
    # 4 mm of 200 mm: twice as large is 4 %, five times 10 %
    assert magnification(found) == 2.0


def test_the_page_has_a_picture_of_every_joint_and_escapes_names() -> None:
    page = tracking_content(robot(("a", EVIL)), EVIL, "other").report()
    assert EVIL not in page and "ran'" not in re.sub(r"&#39;|\\u0027", "", page).split("<h1")[0]
    assert page.count('class="picture"') == 2 + 1 + 2
    assert "deviations 2 times as large" in page.replace("\u00a0", " ")
    names = re.findall(r'<section id="([\w-]+)"', page)
    assert names == ["tracking", "tool-path", "errors-over-time", "settings"]


def test_the_terminal_has_the_headline_and_both_tables() -> None:
    text = printed(tracking_content(robot()))
    assert "RMS error" in text and "Largest error" in text
    assert "divided by that under cascade" in text
