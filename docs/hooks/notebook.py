"""Notebooks of the documentation, run and turned into pages without Jupyter.

`python docs/hooks/notebook.py FILE.ipynb` runs the cells of a notebook and stores what they print.
"""

import json
import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

Notebook = dict[str, Any]


def outputs(notebook: Notebook) -> list[str]:
    """What the code cells print, run one after the other in one namespace."""
    names: dict[str, Any] = {"__name__": "__main__"}
    printed = []
    for cell in _code(notebook):
        with redirect_stdout(StringIO()) as text:
            exec("".join(cell["source"]), names)
        printed.append(text.getvalue())
    return printed


def stored(notebook: Notebook) -> list[str]:
    """What the code cells printed when the notebook was stored."""
    return ["".join(one["text"][0] for one in cell["outputs"]) for cell in _code(notebook)]


def page(notebook: Notebook) -> str:
    """The notebook as Markdown."""
    parts = []
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        parts += [f"```text\n{one['text'][0].rstrip()}\n```" for one in cell["outputs"]]
    return "\n\n".join(parts) + "\n"


def _code(notebook: Notebook) -> list[dict[str, Any]]:
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def _store(path: Path) -> None:
    notebook = json.loads(path.read_text(encoding="utf-8"))
    for number, (cell, text) in enumerate(
        zip(_code(notebook), outputs(notebook), strict=True), start=1
    ):
        cell["execution_count"] = number
        cell["outputs"] = (
            [{"name": "stdout", "output_type": "stream", "text": [text]}] if text else []
        )
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    _store(Path(sys.argv[1]))
