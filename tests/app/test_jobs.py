"""Works in processes of a running app: stopped, killed with it, and what they leave."""

import http.client
import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.guided import Server, serving
from steelyard.app import jobs
from steelyard.app.work_process import finish
from steelyard.app.workspace import opened
from steelyard.base.errors import DataError, OutputError
from steelyard.base.progress import Event, Progress, report_progress, silent


def doubled(number: float, progress: Progress) -> float:
    """A work of the tests; it fails for 0 and for 13."""
    report_progress(progress, "doubling", 0.0, 1.0)
    if number == 0:
        raise DataError("zero", where="here", fix="another")
    return 26.0 / (number - 13.0)


def test_results_of_other_files_or_another_version_are_not_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    workspace = opened(tmp_path / "ws")
    work = jobs.Work("module:function", {"a": 1}, ("robot.toml",), "words")
    first = work.key(workspace)
    assert work.key(workspace) == first
    workspace.write_robot("[robot]\n")
    second = work.key(workspace)
    monkeypatch.setattr(jobs, "PROGRAM", "another")
    assert len({first, second, work.key(workspace)}) == 3


@pytest.mark.parametrize(
    ("number", "stop", "found"),
    [
        (11.0, False, {"result": -13.0}),
        (0.0, False, {"error": {"wrong": "zero", "where": "here", "fix": "another"}}),
        (11.0, True, None),
    ],
)
def test_a_work_leaves_its_result_or_its_error_or_nothing(
    tmp_path: Path, number: float, stop: bool, found: object
) -> None:
    def progress(event: Event) -> bool:
        return not stop

    out = tmp_path / "out.json"
    finish(f"{__name__}:doubled", {"number": number}, out, progress)
    assert (json.loads(out.read_text()) if out.exists() else None) == found


def test_a_defect_is_an_error_that_names_its_place(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    finish(f"{__name__}:doubled", {"number": 13.0}, out, silent)
    error = json.loads(out.read_text())["error"]
    assert "ZeroDivisionError" in error["wrong"] and "test_jobs.py" in error["where"]


@pytest.fixture
def checked(tmp_path: Path, arm: Path) -> Iterator[Path]:
    """A workspace whose logs are checked."""
    pytest.importorskip("starlette")
    folder = tmp_path / "workspace"
    for kind, name in (("robot", "arm.urdf"), ("logs", "a.csv"), ("logs", "b.csv")):
        (folder / kind).mkdir(parents=True, exist_ok=True)
        (folder / kind / name).write_bytes((arm / name).read_bytes())
    with serving(folder) as server:
        server.enter()
        assert server.act("/robot/added")[0] == 204 and server.idle()
        assert server.act("/check/run")[0] == 204 and server.idle()
    yield folder


def fitting(server: Server) -> str:
    """Begin a fit; its key."""
    server.enter()
    assert server.act("/identify/run")[0] == 204
    key = server.running("identifying")
    assert key
    return key


@pytest.mark.slow
def test_a_fit_that_is_stopped_leaves_everything_as_it_was(checked: Path) -> None:
    with serving(checked) as server:
        key = fitting(server)
        assert server.act(f"/stop/{key}")[0] == 204
        assert server.idle()
        assert not list((checked / "models").iterdir())
        assert b"Identify</button>" in server.own("GET", "/identify")[1]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/cwd").exists(), reason="processes are counted in /proc")
def test_a_fit_ends_with_a_server_that_is_killed(checked: Path) -> None:
    with serving(checked) as server:
        fitting(server)
        before = (checked / "robot.toml").read_text()
        server.kill()
    end = time.monotonic() + 60.0
    while working_in(checked) and time.monotonic() < end:
        pass
    assert not working_in(checked)
    with serving(checked) as server:
        server.enter()
        assert server.own("GET", "/identify")[0] == 200
    assert (checked / "robot.toml").read_text() == before
    assert not list((checked / "models").iterdir())
    assert not [p for p in checked.rglob("*") if p.name.endswith(".part")]


def working_in(folder: Path) -> list[str]:
    """Processes whose current folder it is."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            found += [process.name] * (os.readlink(process / "cwd") == str(folder))
        except OSError:
            continue
    return found


@pytest.mark.slow
def test_a_stop_that_comes_before_the_server_runs_ends_it(tmp_path: Path) -> None:
    pytest.importorskip("starlette")
    from steelyard.app.server import serve

    said: list[str] = []
    serve(tmp_path, 0, False, said.append, lambda: True)
    assert len(said) == 1


@pytest.mark.slow
def test_ctrl_c_with_an_open_page_says_nothing(tmp_path: Path) -> None:
    with serving(tmp_path, stderr=subprocess.PIPE) as server:
        server.enter()
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
        connection.request("GET", "/events", headers={"Cookie": server.cookie})
        assert connection.getresponse().readline().startswith(b"data:")
        server.process.send_signal(signal.SIGINT)
        _, said = server.process.communicate(timeout=60)
        connection.close()
    assert said == "" and server.process.returncode == 0


@pytest.mark.slow
def test_an_occupied_port_is_refused(checked: Path) -> None:
    from typer.testing import CliRunner

    from steelyard.cli.app import app

    with serving(checked) as server:
        words = ["app", f"{checked}-2", "--no-browser", "--port", str(server.port)]
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 2 and f"port {server.port} cannot be used" in done.output


@pytest.mark.slow
def test_a_folder_that_is_open_is_not_opened_again(tmp_path: Path) -> None:
    pytest.importorskip("starlette")
    from steelyard.app.server import PORT, serve

    def again() -> None:
        serve(tmp_path, 0, False, lambda _: None, lambda: True)

    with serving(tmp_path) as server:
        with pytest.raises(OutputError, match=f"open in another app.*:{server.port}"):
            again()
    again()
    with serving(tmp_path / "other") as server:
        (tmp_path / ".derived" / PORT).write_text(str(server.port))  # of another folder
        again()
    for text in ("no port", "1", "99999999"):  # of no app
        (tmp_path / ".derived" / PORT).write_text(text)
        again()
