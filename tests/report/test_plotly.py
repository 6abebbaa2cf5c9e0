"""The copy of plotly.js in the package is the one that its source file names."""

import json
from hashlib import sha256

import pytest

from steelyard.report.html import PLOTLY, plotly_script

SOURCE = json.loads((PLOTLY.parent / "source.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", ["plotly.min.js", "LICENSE"])
def test_the_files_are_those_of_the_registry(name):
    assert sha256((PLOTLY.parent / name).read_bytes()).hexdigest() == SOURCE["sha256"][name]


def test_the_version_is_the_one_stated():
    assert f"plotly.js v{SOURCE['version']}\n" in plotly_script()
    assert SOURCE["address"].endswith(f"-{SOURCE['version']}.tgz")
    assert "MIT" in (PLOTLY.parent / "LICENSE").read_text(encoding="utf-8")
