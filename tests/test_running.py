"""The document on running a motion: its programs run as they stand, on a stand-in of a driver."""

import re
import shutil
import sys
import types
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from steelyard.base.files import write_json
from steelyard.base.motion import Rig
from steelyard.excite.controller_file_formats import EXPORTS
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.excite.trajectories.trajectory_files import read_motion
from steelyard.logs.formats import open_log
from steelyard.robot.file.robot_file import load_robot

PAGE = Path(__file__).parent.parent / "docs" / "running.md"


class Driver:
    """What a robot's own library may look like: it is where it was last commanded to be."""

    on_state: Callable[[float, np.ndarray, np.ndarray], object] | None = None

    def __init__(self) -> None:
        self.sent: list[np.ndarray] = []
        self.start: np.ndarray | None = None

    def go_slowly_to(self, q: np.ndarray) -> None:
        self.start = q

    def set_point(self, q: np.ndarray) -> None:
        self.sent.append(q)
        if self.on_state:
            self.on_state(0.002 * len(self.sent), q, 0.0 * q)


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Any]]:
    """What the document's programs leave, run one after the other in a folder of their own."""
    shutil.copy(str(files("steelyard.simulate") / "demo_arm.urdf"), tmp_path)
    (tmp_path / "my_robot.toml").write_text('[robot]\nurdf = "demo_arm.urdf"\n')
    robot = load_robot(tmp_path / "my_robot.toml").robot
    motion = random_fourier(robot, seed=0, period=0.4, harmonics=2)
    write_json(tmp_path / "trajectory.json", motion.to_dict())
    driver = types.ModuleType("my_driver")
    driver.Driver = Driver  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "my_driver", driver)
    monkeypatch.chdir(tmp_path)
    left: dict[str, Any] = {}
    programs = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.S)
    for program in programs:
        exec(compile(program, str(PAGE), "exec"), left)
    yield left


def test_exports_of_both_speeds_are_there(page: dict[str, Any]) -> None:
    texts = [Path(name, "trajectory.yaml").read_text() for name in ("dry", "full")]
    assert ["2 s" in text.splitlines()[0] for text in texts] == [True, False]


def test_a_rig_of_ones_own_follows_and_records(page: dict[str, Any]) -> None:
    rig: Rig = page["rig"]
    driver = page["rig"].driver
    motion = read_motion(Path("trajectory.json"), page["robot"])
    np.testing.assert_array_equal(driver.start, motion.sample([0.0]).q[0])
    table = pl.read_csv("run1.csv")
    log = open_log(Path("run1.csv"))
    assert list(log.columns)[:2] == ["time_s", "q1_rad"] and "tau6_Nm" in table.columns
    assert len(table) == len(driver.sent) > 20 and driver.on_state is None
    names = [f"q{j + 1}_rad" for j in range(page["robot"].n)]
    np.testing.assert_array_equal(table.select(names).to_numpy(), np.array(driver.sent))
    before = len(driver.sent)
    rig.send(motion)
    assert len(driver.sent) > before and len(pl.read_csv("run1.csv")) == len(table)


def test_the_table_of_formats_is_whole() -> None:
    rows = re.findall(r"^\| `(\w+)` \| `([\w.]+)` \|", PAGE.read_text("utf-8"), re.M)
    assert rows == [(name, export.file) for name, export in EXPORTS.items()]
