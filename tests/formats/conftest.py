"""Memory of the process, as the system counts it."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

STATUS = Path("/proc/self/status")


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
