"""Searches in processes of their own: the same whatever their number, and none is left behind."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from excite.tabled import OPEN, arm, model_with_open_friction, searching_here
from steelyard.base.errors import DataError
from steelyard.base.progress import Event, Progress, Stopped, silent
from steelyard.excite.design_problem_from_tables import build
from steelyard.excite.search import parallel_search
from steelyard.excite.search.parallel_search import SearchBudget, SearchResult, search_in_parallel

pytestmark = pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks at processes in /proc")

TABLES = f"""{OPEN}[excitation.limits]
effort = "any"
[excitation.motion]
period = 4.0
harmonics = 2
"""


def harvest(
    folder: Path, effort: SearchBudget, progress: Progress = silent, method: str = "gradient"
) -> SearchResult:
    loaded = arm(folder, TABLES)
    model = model_with_open_friction(loaded)
    return search_in_parallel((loaded, model, None), build(loaded, model), method, effort, progress)


def workers() -> list[int]:
    """Processes of this one that search."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes()
            parent = (folder / "stat").read_text().rpartition(")")[2].split()[1]
        except OSError:
            continue
        if b"search.parallel_search" in words and int(parent) == os.getpid():
            found.append(int(folder.name))
    return found


@pytest.fixture(autouse=True)
def _nobody_stays() -> Iterator[None]:
    yield
    assert workers() == []


@pytest.mark.slow
def test_the_seed_alone_decides(tmp_path: Path) -> None:
    two = harvest(tmp_path, SearchBudget(60.0, searches=2, processes=2))
    with patch.object(parallel_search, "_workers", searching_here):
        one = harvest(tmp_path, SearchBudget(60.0, searches=2))
        other = harvest(tmp_path, SearchBudget(60.0, searches=1, seed=1))
    assert one.searches == two.searches == 2 and not one.stopped
    for mine, theirs in zip(one.best, two.best, strict=True):
        assert (mine.number, mine.criterion_value) == (theirs.number, theirs.criterion_value)
        np.testing.assert_array_equal(mine.x, theirs.x)
    assert other.best[0].criterion_value != one.best[0].criterion_value
    figures = [figure for _, figure in two.course]
    assert figures == sorted(figures, reverse=True) and figures[-1] == two.best[0].criterion_value


@pytest.mark.usefixtures("searches_here")
def test_the_course_shows_improvements_within_a_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = harvest(tmp_path, SearchBudget(60.0, searches=1))
    monkeypatch.setattr(parallel_search, "TELLING_SECONDS", 0.0)
    monkeypatch.setattr(parallel_search, "LOOKING_SECONDS", 0.0)
    found = harvest(tmp_path, SearchBudget(60.0, searches=1))
    (best,) = found.best
    np.testing.assert_array_equal(best.x, plain.best[0].x)
    figures = [figure for _, figure in found.course]
    assert len(figures) > 5 and figures[0] > 1.1 * figures[-1]
    assert figures == sorted(figures, reverse=True) and figures[-1] == best.criterion_value


@pytest.mark.slow
def test_no_more_processes_than_searches(tmp_path: Path) -> None:
    seen = []

    def watch(event: Event) -> bool:
        seen.append(len(workers()))
        return True

    found = harvest(tmp_path, SearchBudget(60.0, searches=1, processes=8), watch)
    assert found.searches == 1 and max(seen) == 1


@pytest.mark.usefixtures("searches_here")
def test_progress_counts_searches_as_well_as_seconds(tmp_path: Path) -> None:
    seen = list[Event]()
    harvest(tmp_path, SearchBudget(600.0, searches=2), lambda event: seen.append(event) or True)
    assert all(event.done >= 300.0 for event in seen if event.note.endswith("of 1"))
    assert seen[-1].done >= 300.0 and {event.total for event in seen} == {600.0}


@pytest.mark.slow
def test_time_ends_it_and_keeps_what_there_is(tmp_path: Path) -> None:
    begun = time.monotonic()
    found = harvest(tmp_path, SearchBudget(3.0))
    assert time.monotonic() - begun > 2.5
    assert found.best and len(found.best) <= 4 and not found.stopped
    assert [f.criterion_value for f in found.best] == sorted(f.criterion_value for f in found.best)


def stopping(ready: Callable[[Event], bool]) -> Progress:
    return lambda event: not ready(event)


@pytest.mark.slow
def test_a_requested_stop_gives_the_best_so_far(tmp_path: Path) -> None:
    found = harvest(tmp_path, SearchBudget(60.0), stopping(lambda e: "best" in e.note))
    assert found.stopped and found.best


def test_a_requested_stop_before_there_is_anything(tmp_path: Path) -> None:
    with pytest.raises(Stopped):
        harvest(tmp_path, SearchBudget(60.0, processes=2), stopping(lambda e: True))


def killing(most: int, every: bool) -> Progress:
    """Kill processes, up to a number, once they run; or all of them."""
    done: list[int] = []

    def watch(event: Event) -> bool:
        for process in workers():
            if process not in done and (every or len(done) < most):
                done.append(process)
                os.kill(process, 9)
        return True

    return watch


@pytest.mark.slow
def test_the_others_go_on_when_one_is_killed(tmp_path: Path) -> None:
    found = harvest(tmp_path, SearchBudget(60.0, searches=2, processes=2), killing(1, every=False))
    assert found.killed == 1 and found.best


def test_all_of_them_killed_is_reported(tmp_path: Path) -> None:
    with pytest.raises(DataError) as caught:
        harvest(tmp_path, SearchBudget(60.0, processes=2), killing(2, every=True))
    assert "2 search processes ended early (signal 9)" in caught.value.wrong
    assert "--processes" in caught.value.fix


@pytest.mark.usefixtures("searches_here")
def test_an_error_in_a_worker_is_reported(tmp_path: Path) -> None:
    loaded = arm(tmp_path, TABLES.replace("bodies = false", "bodies = true"))
    model = model_with_open_friction(loaded)
    problem = build(loaded, model)
    (tmp_path / "arm.urdf").unlink()
    with pytest.raises(DataError, match="there is no such file"):
        search_in_parallel((loaded, model, None), problem, "gradient", SearchBudget(60.0))


@pytest.mark.usefixtures("searches_here")
def test_a_flaw_in_a_worker_is_reported_with_its_traceback(tmp_path: Path) -> None:
    loaded = arm(tmp_path, TABLES)
    model = model_with_open_friction(loaded)
    broken = (replace(loaded, excitation=None), model, None)
    with pytest.raises(RuntimeError, match="AttributeError"):
        search_in_parallel(broken, build(loaded, model), "gradient", SearchBudget(60.0))


def task(folder: Path, searches: int | None, seconds: float = 60.0) -> bytes:
    loaded = arm(folder, TABLES)
    tables = (loaded, model_with_open_friction(loaded), None)
    return parallel_search.task_of(tables, "gradient", SearchBudget(seconds, searches), 0)


def worker() -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        [sys.executable, "-m", "steelyard.excite.search.parallel_search"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


@pytest.mark.slow
def test_the_time_of_a_worker_does_not_begin_with_its_start(tmp_path: Path) -> None:
    with worker() as process:
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(task(tmp_path, None, seconds=0.0))
        process.stdin.flush()
        assert [json.loads(line)["whole"] for line in process.stdout] == [False]


@pytest.mark.slow
def test_a_worker_ends_with_its_parent(tmp_path: Path) -> None:
    with worker() as process:
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(task(tmp_path, None))
        process.stdin.flush()
        lines = (json.loads(line) for line in process.stdout)
        assert next(line for line in lines if "reached" not in line)["whole"]
        process.stdin.close()
        assert process.wait(timeout=10.0) == 0


@pytest.mark.slow
def test_a_worker_that_is_done_says_nothing_else(tmp_path: Path) -> None:
    with worker() as process:
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(task(tmp_path, 1))
        process.stdin.flush()
        lines = process.stdout.read().splitlines()
        assert process.wait(timeout=10.0) == 0
        assert process.stderr is not None and process.stderr.read() == b""
    *reached, last = map(json.loads, lines)
    assert last["number"] == 0 and all(line.keys() == {"reached"} for line in reached)


SCRIPT = """
import sys
from steelyard.model.model import model_with_open_friction
from steelyard.excite.searched_or_planned_motion import design
from steelyard.excite.search.parallel_search import SearchBudget
from steelyard.robot.file.robot_file import load_robot

loaded = load_robot("arm.toml")
found = design((loaded, model_with_open_friction(loaded), None), SearchBudget(60.0, searches=1))
print(found.certificate.holds, found.searches)
"""


@pytest.mark.slow
def test_from_a_script_without_a_main_guard(tmp_path: Path) -> None:
    """Its own folder must not reach the processes: here lies a module that would break them."""
    arm(tmp_path, TABLES)
    (tmp_path / "numpy.py").write_text("raise SystemExit(3)")
    folder = tmp_path / "scripts"
    folder.mkdir()
    (folder / "script.py").write_text(SCRIPT)
    done = subprocess.run(
        [sys.executable, str(folder / "script.py")],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert (done.stdout, done.stderr) == ("True 1\n", "")
