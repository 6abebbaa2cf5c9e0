"""The copy of three.js in the package is the one that its source file names."""

import gzip
import json
import re
from hashlib import sha256
from pathlib import Path

import pytest

from steelyard.app.step import TEMPLATES, THREE

ENTRY = Path(__file__).parents[2] / "tools" / "three_entry.js"
THREE_JS = gzip.decompress(THREE.read_bytes())
SOURCE = json.loads((THREE.parent / "source.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", ["three.min.js", "LICENSE"])
def test_the_files_are_those_of_their_source(name: str) -> None:
    content = THREE_JS if name == "three.min.js" else (THREE.parent / name).read_bytes()
    assert sha256(content).hexdigest() == SOURCE["sha256"][name]


def test_the_licence_is_that_of_three() -> None:
    assert SOURCE["package"] == f"three@{SOURCE['version']}"
    assert "MIT" in (THREE.parent / "LICENSE").read_text(encoding="utf-8")


def test_all_that_the_scene_uses_is_in_the_copy_and_nothing_else() -> None:
    scene = (TEMPLATES / "scene.js").read_text(encoding="utf-8")
    named = re.search(r"export \{(.*?)\} from \"three\"", ENTRY.read_text(), re.DOTALL)
    assert named is not None
    offered = set(re.findall(r"\w+", named[1])) | {"OrbitControls"}
    assert set(re.findall(r"Three\.(\w+)", scene)) == offered
