"""The notebook of the documentation prints what is stored in it."""

import importlib.util
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
NOTEBOOK = json.loads((ROOT / "docs/tutorials/notebook.ipynb").read_text(encoding="utf-8"))


def hook() -> object:
    spec = importlib.util.spec_from_file_location("notebook", ROOT / "docs/hooks/notebook.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_cells_print_what_is_stored() -> None:
    notebook = hook()
    assert notebook.outputs(NOTEBOOK) == notebook.stored(NOTEBOOK)  # type: ignore[attr-defined]


def test_the_page_has_every_cell_and_its_output() -> None:
    page = hook().page(NOTEBOOK)  # type: ignore[attr-defined]
    code = [cell for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]
    assert page.count("```python\n") == len(code) >= 6
    assert all("".join(cell["source"]) in page for cell in NOTEBOOK["cells"])
    assert all(one["text"][0] in page for cell in code for one in cell["outputs"])
