"""Jinja2, imported when a page is made, and the copy of plotly.js in pages."""

import base64
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.report.text import words

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).parent / "templates"
PLOTLY = Path(__file__).parent / "plotly" / "plotly.min.js.gz"
"""The parts that pages use, compressed. The version is in `source.json` beside it;
`tools/update_plotly.py` replaces it."""


PICTURE = 'class="picture'
"""What marks a picture in the page."""


@cache
def _environment() -> "Environment":
    """Templates that escape everything: names come from files of strangers."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES, encoding="utf-8"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "significant": words.significant,
        "percent": words.percent,
        "alike": words.alike,
        "share": words.share,
        "relative": words.relative,
        "kept": words.kept,
        "breakable": breakable,
    }
    environment.globals["count"] = words.count
    return environment


def fill(template: str, values: Mapping[str, Any]) -> str:
    """A template of this room filled with values, as safe HTML."""
    from markupsafe import Markup

    return Markup(_environment().get_template(template).render(values))


def breakable(name: str) -> str:
    """A name as safe HTML that may be broken behind dots and underscores, never inside a word."""
    from markupsafe import Markup

    return Markup("<wbr>").join(words.pieces(name))


def verbatim(name: str) -> str:
    """A style sheet or script of this room, to stand in a page as it is."""
    from markupsafe import Markup

    return Markup((TEMPLATES / name).read_text(encoding="utf-8"))


def plotly_archive() -> str:
    """plotly.js, compressed by gzip, in base64."""
    return base64.b64encode(PLOTLY.read_bytes()).decode()


def script_json(value: object) -> str:
    """JSON that cannot end the script element it stands in.

    Raises:
        ValueError: It holds NaN or infinity.
    """
    from markupsafe import Markup

    text = json.dumps(value, allow_nan=False, ensure_ascii=True, separators=(",", ":"))
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)


def packed(values: Array, dtype: Literal["f4", "f8", "i1"] = "f4") -> dict[str, str]:
    """Plotly's form of an array in single or double precision, or in bytes; NaN breaks a line."""
    raw = values.astype(f"<{dtype}").tobytes()
    return {"dtype": dtype, "bdata": base64.b64encode(raw).decode()}


def rounded(value: float, digits: int = 6) -> float | None:
    """A number for JSON; `None` if it is not finite."""
    return float(f"{value:.{digits}g}") if np.isfinite(value) else None
