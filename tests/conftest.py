"""Machine code of the tests is kept for one session only."""

import os
import tempfile

# matrices are small here: threads of their own only wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest


def pytest_configure(config: pytest.Config) -> None:
    """A kernel cache of our own, so that tests neither use nor fill the user's.

    Set before tests are collected: some modules make a regressor when they are imported.
    """
    folder = tempfile.TemporaryDirectory(prefix="steelyard-tests-")
    os.environ["STEELYARD_CACHE"] = folder.name
    config.add_cleanup(folder.cleanup)
