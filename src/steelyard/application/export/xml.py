"""XML as model files have it: exact numbers, and a comment that says where they come from."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from steelyard.application.export.content import NAMES, Content, Format
from steelyard.arrays import Array, frozen
from steelyard.estimation.identified import IdentifiedModel

ROUNDING = 1e-14
"""What a solver leaves of zero, relative to the body it is of."""

UNLIMITED = 1e9
"""Written where a format wants a limit and none is known."""


def number(value: float) -> str:
    """The shortest text that reads back as the same number."""
    return repr(float(value) + 0.0)


def numbers(values: ArrayLike) -> str:
    """Numbers with blanks between."""
    return " ".join(number(value) for value in frozen(values).ravel())


def snapped(values: ArrayLike, size: float) -> Array:
    """Numbers with zeros where they are the rounding of a number of some size."""
    known = frozen(values)
    return np.where(np.abs(known) <= ROUNDING * size, 0.0, known)


def limit(value: float) -> str:
    """A limit; a large one for infinity."""
    return number(min(max(value, -UNLIMITED), UNLIMITED))


def document(root: ET.Element, head: str) -> str:
    """A whole file."""
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="utf-8"?>\n{head}\n{text}\n'


def head_of(
    identified: IdentifiedModel, content: Content, form: Format, more: Iterable[str] = ()
) -> str:
    """The comment at a file's head: where the numbers come from, and what the file lacks.

    Args:
        identified: The model.
        content: What the file holds of it.
        form: The file's format.
        more: Further sentences on the file.
    """
    origin = identified.provenance
    lines = [
        f"{content.robot.name}: identified with steelyard {origin.version} from logs.",
        f"Estimate: {identified.estimate.estimator}.",
        f"Runs: {', '.join(origin.runs) or 'unknown'}.",
        "Inputs, SHA-256:",
        *(f"  {role}: {value}" for role, value in origin.inputs.items()),
        "Inertias of moving links include all links that are fixed to them.",
        *more,
        f"{NAMES[form]} cannot represent these parts of the identified model:",
        *(f"  - {sentence}" for sentence in content.unsupported or ("nothing",)),
    ]
    return comment("\n".join(lines))


def comment(text: str) -> str:
    """An XML comment; two hyphens in a row would end it."""
    safe = text.replace("--", "- -").replace("--", "- -")
    return "<!--\n" + "\n".join(f"  {line}" for line in safe.splitlines()) + "\n-->"
