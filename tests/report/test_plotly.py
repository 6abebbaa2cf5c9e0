"""The copy of plotly.js in the package is the one that its source file names."""

import base64
import gzip
import html
import json
import re
import zlib
from hashlib import sha256
from pathlib import Path

import pytest

from report.conftest import rendered_only
from steelyard.report.page import PLOTLY

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
    report = Path(PLOTLY).parents[2]
    texts = [path.read_text(encoding="utf-8") for path in report.rglob("*.py")]
    used = {kind for kind in KINDS if any(f'"type": "{kind}"' in text for text in texts)}
    assert used and used <= kinds
    assert all(f'name:"{kind}"'.encode() in PLOTLY_JS for kind in kinds | {"scatter"})


def test_a_page_unpacks_every_kind_of_block(usual, browse):
    text = "".join(f"f({k % 7}); // µ {k * k}\n" for k in range(9000)) + "x" * 40_000
    fixed = zlib.compressobj(9, zlib.DEFLATED, 31, 9, zlib.Z_FIXED)
    packed = (
        gzip.compress(text.encode(), 0, mtime=0),
        fixed.compress(text.encode()) + fixed.flush(),
        gzip.compress(text.encode(), 9, mtime=0),
        gzip.compress(b"", mtime=0),
    )
    archives = json.dumps([base64.b64encode(one).decode() for one in packed])
    script = f"document.body.dataset.found = JSON.stringify({archives}.map(unzipped))"
    seen = browse(rendered_only(usual, "effort"), script)
    (found,) = re.findall(r'data-found="([^"]*)"', seen.dom)
    assert json.loads(html.unescape(found)) == [text, text, text, ""]
    assert PLOTLY.read_bytes()[3] == 0, "a head without optional parts"
