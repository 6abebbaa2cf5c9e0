"""Models of strangers: devices, pipes and counts without bound are refused with a clear message."""

import os
from pathlib import Path

import pytest

from steelyard import load_robot
from steelyard.base.errors import ModelError

BODY = (
    '<worldbody><body name="a"><joint name="j" type="hinge"/><geom size=".1"/></body></worldbody>'
)


def _refused(folder: Path, text: str) -> ModelError:
    file = folder / "arm.xml"
    file.write_text(f"<mujoco>{text}</mujoco>")
    with pytest.raises(ModelError) as refused:
        load_robot(file)
    return refused.value


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes among its files")
@pytest.mark.parametrize(
    "names", ['<include file="{}"/>', '<asset><mesh name="m" file="{}"/></asset>']
)
def test_what_is_no_file_on_a_disk_is_not_read(tmp_path: Path, names: str) -> None:
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "zero.stl").symlink_to("/dev/zero")
    for file in ("pipe.stl", "zero.stl"):
        error = _refused(tmp_path, names.format(file) + BODY)
        assert "device or a pipe" in error.wrong
        assert error.where.endswith(file)


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        f'<size nuser_body="2000000000"/>{BODY}',
        '<asset><hfield name="h" nrow="200000" ncol="200000" size="1 1 1 1"/></asset>' + BODY,
        '<asset><hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/></asset>' + BODY,
        '<worldbody><replicate count="2000"><replicate count="2000"><body><joint/>'
        '<geom size=".1"/></body></replicate></replicate></worldbody>',
    ],
)
def test_counts_that_fill_the_memory_are_refused(
    tmp_path: Path, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("steelyard.robot.models.mjcf.MOST_SECONDS", 5)
    monkeypatch.setattr("steelyard.robot.models.mjcf.MOST_MEMORY", 1 << 30)
    assert "counts and sizes" in _refused(tmp_path, text).fix


def test_counts_within_bounds_are_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # the process that compiles takes no module from there
    (tmp_path / "mujoco.py").write_text("raise SystemExit('run from the folder of a stranger')")
    file = tmp_path / "arm.xml"
    file.write_text(
        '<mujoco><worldbody><body name="a"><joint name="j" type="hinge"/><geom size=".1"/>'
        '<replicate count="3"><geom size=".01" pos=".1 0 0"/></replicate></body></worldbody>'
        "</mujoco>"
    )
    assert [joint.name for joint in load_robot(file).robot.joints] == ["j"]


@pytest.mark.parametrize("origin", ["1e308 0 0", "0 -1e200 0"])
def test_numbers_that_overflow_are_refused(tmp_path: Path, origin: str) -> None:
    """Each is finite, but the inertia about the link frame's origin is not."""
    file = tmp_path / "arm.urdf"
    file.write_text(
        '<robot name="arm"><link name="base"/><link name="hand"><inertial>'
        f'<origin xyz="{origin}"/><mass value="2"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
        '<joint name="j" type="continuous"><parent link="base"/><child link="hand"/></joint>'
        "</robot>"
    )
    with pytest.raises(ModelError, match="'hand' are too large"):
        load_robot(file)
