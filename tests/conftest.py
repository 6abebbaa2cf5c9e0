"""Machine code of the tests is kept for one session only."""

import os

import pytest


@pytest.fixture(scope="session", autouse=True)
def private_cache(tmp_path_factory: pytest.TempPathFactory) -> None:
    """A kernel cache of our own, so that tests neither use nor fill the user's."""
    os.environ["STEELYARD_CACHE"] = str(tmp_path_factory.mktemp("cache"))
