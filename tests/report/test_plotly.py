"""The copy of plotly.js in the package is the one that its source file names."""

import gzip
import json
import re
from hashlib import sha256
from pathlib import Path

import pytest

from steelyard.report import render
from steelyard.report.html import PLOTLY

ENTRY = Path(__file__).parents[2] / "tools" / "plotly_entry.js"
PLOTLY_JS = gzip.decompress(PLOTLY.read_bytes())
SOURCE = json.loads((PLOTLY.parent / "source.json").read_text(encoding="utf-8"))
KINDS = {
    *("bar", "barpolar", "box", "cone", "contour", "heatmap", "histogram", "histogram2d", "image"),
    *("isosurface", "mesh3d", "pie", "sankey", "scatter3d", "scattergl", "scatterpolar"),
    *("streamtube", "surface", "violin", "volume"),
}
"""Kinds of trace of plotly.js that core lacks."""


@pytest.mark.parametrize("name", ["plotly.min.js", "LICENSE"])
def test_the_files_are_those_of_their_source(name):
    content = PLOTLY_JS if name == "plotly.min.js" else (PLOTLY.parent / name).read_bytes()
    assert sha256(content).hexdigest() == SOURCE["sha256"][name]


def test_the_version_is_the_one_stated():
    assert f'.version="{SOURCE["version"]}"'.encode() in PLOTLY_JS
    assert SOURCE["package"] == f"plotly.js@{SOURCE['version']}"
    assert "MIT" in (PLOTLY.parent / "LICENSE").read_text(encoding="utf-8")


def test_kinds_of_trace_of_all_figures_are_in_the_copy():
    kinds = set(re.findall(r"plotly\.js/lib/(\w+)", ENTRY.read_text(encoding="utf-8"))) - {"core"}
    report = Path(PLOTLY).parents[1]
    texts = [path.read_text(encoding="utf-8") for path in report.rglob("*.py")]
    used = {kind for kind in KINDS if any(f'"type": "{kind}"' in text for text in texts)}
    assert used and used <= kinds
    assert all(f'name:"{kind}"'.encode() in PLOTLY_JS for kind in kinds | {"scatter"})


def test_a_browser_too_old_for_the_archive_says_so(usual, browse):
    old = "<head><script>delete window.DecompressionStream;</script>"
    seen = browse(render(usual).replace("<head>", old))
    assert "This browser is too old to draw the figures of this page" in seen.dom
    assert seen.errors == []
