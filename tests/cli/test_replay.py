"""`steelyard replay`: a server in the browser's reach, links where Pinocchio has them, Ctrl-C."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cli.conftest import Command
from steelyard.excite.page.browser_replay import Clock, Replay, Stage, replayed, staged
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.robot.file.robot_file import load_robot

ARM = Path(__file__).parents[2] / "src" / "steelyard" / "simulate" / "demo_arm.urdf"
FREE = 18080


@pytest.fixture(scope="module")
def stage() -> Stage:
    loaded = load_robot(ARM)
    return staged(loaded, random_fourier(loaded.robot, seed=5, period=4.0))


@pytest.fixture
def replay(stage: Stage) -> Iterator[Replay]:
    pytest.importorskip("viser")
    shown = replayed(stage, "127.0.0.1", FREE)
    yield shown
    shown.stop()


@pytest.fixture
def motion(stage: Stage, tmp_path: Path) -> Path:
    path = tmp_path / "trajectory.json"
    path.write_text(json.dumps(stage.trajectory.to_dict()))
    return path


def _key(position: np.ndarray) -> tuple[float, ...]:
    return tuple(np.round(position, 6) + 0.0)


def test_the_links_in_the_scene_are_where_pinocchio_has_them(replay: Replay) -> None:
    pin = pytest.importorskip("pinocchio")
    model = pin.buildModelFromUrdf(str(ARM))
    geometry = pin.buildGeomFromUrdf(model, str(ARM), pin.GeometryType.COLLISION)
    data, places = model.createData(), pin.GeometryData(geometry)
    for now in (0.0, 1.37, 3.2):
        replay.show(now)
        q = replay.stage.trajectory.sample([now]).q[0]
        pin.updateGeometryPlacements(model, data, geometry, places, q)
        expected = sorted((_key(p.translation), pin.Quaternion(p.rotation)) for p in places.oMg)
        drawn = sorted((_key(thing.position), thing.wxyz) for thing in replay._things)
        assert len(drawn) == len(expected) > 6
        for (position, wxyz), (there, turned) in zip(drawn, expected, strict=True):
            np.testing.assert_allclose(position, there, atol=2e-6)
            other = np.array([turned.w, turned.x, turned.y, turned.z])
            assert abs(wxyz @ other) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.slow
def test_a_browser_gets_the_page(replay: Replay) -> None:
    with urllib.request.urlopen(replay.address, timeout=10) as answer:
        assert answer.status == 200 and b"<html" in answer.read()


def test_playing_moves_the_scene_until_it_is_stopped(replay: Replay) -> None:
    ended = threading.Event()
    before = [np.array(thing.position) for thing in replay._things]
    player = threading.Thread(target=replay.run, args=(ended.is_set,))
    player.start()
    deadline = time.monotonic() + 30.0
    while replay.clock.now <= 0.2 and time.monotonic() < deadline:
        time.sleep(0.02)
    ended.set()
    player.join(timeout=30.0)
    assert not player.is_alive() and replay.clock.now > 0.2
    pairs = zip(replay._things, before, strict=True)
    moved = [np.abs(thing.position - b).max() for thing, b in pairs]
    assert max(moved) > 1e-4
    rotations, origins = replay.stage.at(replay.clock.now)
    np.testing.assert_allclose([thing.position for thing in replay._things], origins)


@pytest.mark.slow
def test_the_controls_pause_move_time_and_set_the_speed(replay: Replay) -> None:
    handles = replay.server.gui._gui_input_handle_from_uuid.values()
    labels = {handle.label: handle for handle in handles}
    browser = SimpleNamespace(client=object())

    def touched(label: str, event: object = browser) -> None:
        for react in labels[label]._impl.update_cb:
            react(event)

    touched("Pause")
    assert not replay.clock.running and labels["Pause"].label == "Play"
    touched("Pause")
    assert replay.clock.running and labels["Pause"].label == "Pause"
    labels["Time [s]"]._impl.value = 2.5
    touched("Time [s]", SimpleNamespace(client=None))
    assert replay.clock.running and replay.clock.now != 2.5, "the player's own move pauses it"
    touched("Time [s]")
    assert not replay.clock.running and replay.clock.now == 2.5
    labels["Speed"]._impl.value = 0.5
    touched("Speed")
    assert replay.clock.speed == 0.5
    labels["Path of the tool"]._impl.value = False
    touched("Path of the tool")
    assert not replay.server.scene.get_handle_by_name("/path of the tool").visible


def test_the_clock_begins_anew_and_stands_still_when_it_should() -> None:
    clock = Clock(4.0, speed=2.0, now=3.0)
    clock.advance(1.0)
    assert clock.now == pytest.approx(1.0)
    clock.running = False
    clock.advance(1.0)
    assert clock.now == pytest.approx(1.0)


def test_without_viser_the_line_that_installs_it_is_reported(
    command: Command, motion: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    done = command("replay", ARM, motion)
    assert done.exit_code == 2
    assert 'pip install ".[replay]"' in done.output


def test_an_address_of_another_machine_is_refused(command: Command, motion: Path) -> None:
    pytest.importorskip("viser")
    done = command("replay", ARM, motion, "--host", "203.0.113.7")
    assert done.exit_code == 2
    assert "this machine has no address '203.0.113.7'" in done.output and "--host" in done.output


def test_a_motion_of_another_robot_is_refused(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "other.csv"
    path.write_text("time_s,q1_rad\n0,0\n1,1\n2,0\n")
    done = command("replay", ARM, path)
    assert done.exit_code == 2 and "no column for joint" in done.output


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT for a child")
def test_ctrl_c_ends_it_cleanly(motion: Path, tmp_path: Path) -> None:
    pytest.importorskip("viser")
    output = tmp_path / "output.txt"
    line = [sys.executable, "-m", "steelyard", "replay", str(ARM), str(motion)]
    with output.open("w") as out:
        child = subprocess.Popen(
            [*line, "--port", str(FREE + 100), "--speed", "0.5"],
            stdout=out,
            stderr=subprocess.STDOUT,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
        try:
            deadline = time.monotonic() + 60.0
            while "Ctrl-C" not in output.read_text() and time.monotonic() < deadline:
                time.sleep(0.1)
            address = re.search(r"http://\S+", output.read_text())
            assert address is not None
            with urllib.request.urlopen(address[0], timeout=10) as answer:
                assert answer.status == 200
            child.send_signal(signal.SIGINT)
            assert child.wait(timeout=20) == 0
        finally:
            child.kill()
            child.wait()
    assert "Traceback" not in output.read_text()
    assert len(output.read_text().splitlines()) == 1
