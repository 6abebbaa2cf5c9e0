"""A cache of machine code for tests alone; memory as the system counts it."""

import gc
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

# matrices are small here: threads of their own only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("STEELYARD_TRACEBACK", "1")

import pytest
import typer.testing
from hypothesis import HealthCheck, settings

from browser import Tab, chromium, running
from steelyard.symbolic.native.cache import key_of

STATUS = Path("/proc/self/status")

# examples take as long as a busy machine needs
settings.register_profile(
    "suite", max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("suite")

# a runner makes all commands and their options anew at each call, which takes 15 ms
typer.testing._get_command = cache(typer.testing._get_command)


def pytest_configure(config: pytest.Config) -> None:
    """A kernel cache of our own, so that tests neither use nor fill the user's.

    It is kept from session to session while the files that programs are made from stay as they are
    (`cache.SOURCES`). Set before tests are collected: some modules make a regressor when they are
    imported. Parallel workers inherit that of the process that started them.
    """
    if hasattr(config, "workerinput"):
        return
    kept = getattr(config, "cache", None)
    if kept is None:
        folder = tempfile.TemporaryDirectory(prefix="steelyard-tests-")
        os.environ["STEELYARD_CACHE"] = folder.name
        config.add_cleanup(folder.cleanup)
        return
    place = kept.mkdir("kernels") / key_of("tests")
    for earlier in place.parent.iterdir():
        if earlier != place:
            shutil.rmtree(earlier, ignore_errors=True)
    os.environ["STEELYARD_CACHE"] = str(place)


def pytest_collection_finish() -> None:
    """Modules and collected tests stay to the end: garbage is not searched among them."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tab]:
    """One Chromium for all tests of a worker."""
    program = chromium()
    if program is None:
        pytest.skip("no Chromium (chromium, chromium-browser or google-chrome) on the path")
    with running(program, tmp_path_factory.mktemp("browser")) as tab:
        yield tab


@pytest.fixture(scope="session")
def small_arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an arm of two joints, two logs and its model; tests work in copies of it."""
    from small_arm import made

    place = tmp_path_factory.mktemp("small_arm")
    made(place)
    return place


@pytest.fixture
def few_stretches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bands are calibrated on two stretches that are left out instead of five.

    That takes half of the time of an identification.
    """
    from steelyard.estimate.scores.cross_validation import stretches_left_out

    monkeypatch.setattr(
        "steelyard.estimate.scores.cross_validation.stretches_left_out",
        lambda runs, information: stretches_left_out(runs, information)[:2],
    )


@pytest.fixture
def searches_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Motions are searched in this process: one of its own loads all packages, in 0.8 s."""
    from excite.tabled import searching_here

    monkeypatch.setattr("steelyard.excite.search.parallel_search._workers", searching_here)


@pytest.fixture
def peak() -> Callable[[], float]:
    """How far memory has risen since the test began, at most [MiB]."""
    if not STATUS.exists():
        pytest.skip("this system does not tell a process its memory")

    def figure(name: str) -> float:
        found = re.search(rf"{name}:\s+(\d+) kB", STATUS.read_text())
        return float(found[1]) / 1024.0 if found else 0.0

    Path("/proc/self/clear_refs").write_text("5")
    before = figure("VmRSS")
    return lambda: figure("VmHWM") - before
