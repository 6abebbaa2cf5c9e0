"""A page as one HTML file: filled templates, its sections, and JSON inside it."""

from __future__ import annotations

import base64
import json
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version as installed
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from steelyard.base.arrays import Array
from steelyard.report import words
from steelyard.report.tables import PlainTable, text_table

if TYPE_CHECKING:
    from jinja2 import Environment
    from rich.console import RenderableType


TEMPLATES = Path(__file__).parent / "templates"
PLOTLY = Path(__file__).parent / "plotly" / "plotly.min.js.gz"
"""The parts that pages use, compressed. The version is in `source.json` beside it;
`tools/update_plotly.py` replaces it."""


PICTURE = 'class="picture'
"""What marks a picture in the page."""


@cache
def _environment() -> Environment:
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
        "alike": words.rounded_to_uncertainty,
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


Numbers = Mapping[str, Any]
"""Everything a section's template shows, by name."""


class Section(ABC):
    """One section of the report."""

    name: ClassVar[str]
    """The section's identifier in the page."""

    title: ClassVar[str]
    """Its heading."""

    folded: ClassVar[bool] = False
    """Whether the page shows its heading alone, until a click opens it."""

    @abstractmethod
    def numbers(self, content: Any) -> Numbers | None:
        """What there is to show; `None` leaves the section out."""

    @abstractmethod
    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""

    def to_dict(self, content: Any) -> dict[str, Any]:
        """Fields of `--json`; they are there, and `None`, where there is nothing to show."""
        return {}

    def printed(self, content: Any) -> Iterable[RenderableType]:
        """What the terminal shows, an empty line before each."""
        return ()

    def detailed(self, content: Any) -> Iterable[RenderableType]:
        """What the terminal shows below that with `--verbose`."""
        return ()


class TableSection(Section):
    """A section that is plain tables."""

    in_terminal: ClassVar[bool] = False
    """Whether the terminal shows them with `--verbose`."""

    @abstractmethod
    def tables(self, content: Any) -> Sequence[PlainTable]:
        """The tables; none leaves the section out."""

    def numbers(self, content: Any) -> Numbers | None:
        """The tables under the section's title."""
        tables = self.tables(content)
        return {"tables": tables, "title": self.title} if tables else None

    def show(self, numbers: Numbers) -> str:
        """The tables as safe HTML."""
        return fill("tables.html", numbers)

    def detailed(self, content: Any) -> Iterable[RenderableType]:
        """The tables, if the terminal shows them."""
        if self.in_terminal:
            yield from (text_table(table, self.title) for table in self.tables(content))


NO_FIGURES: Numbers = dict.fromkeys(("words", "folded", "note"), "") | dict.fromkeys(
    ("tables", "legend", "groups"), ()
)
"""What the template of figures shows, all of it empty."""


class FigureSection(Section):
    """A section that is figures, with words and tables."""

    template: ClassVar[str] = "figures.html"

    def show(self, numbers: Numbers) -> str:
        """The figures as safe HTML; numbers that the section does not have are empty."""
        return fill(self.template, {"title": self.title, **NO_FIGURES, **numbers})


@dataclass(frozen=True)
class Shown:
    """A section of a page.

    Attributes:
        name: Its identifier.
        title: Its heading.
        body: Safe HTML.
        folded: Whether it is closed until a click opens it.
    """

    name: str
    title: str
    body: str
    folded: bool = False

    @classmethod
    def of(cls, section: Section, numbers: Numbers) -> Shown:
        """A section with its numbers."""
        return cls(section.name, section.title, section.show(numbers), section.folded)


def shown_sections(sections: Iterable[Section], content: Any) -> list[Shown]:
    """The sections that have something to show."""
    numbered = ((section, section.numbers(content)) for section in sections)
    return [Shown.of(section, numbers) for section, numbers in numbered if numbers is not None]


def figures(name: str, title: str, **numbers: Any) -> Shown:
    """A section of words, tables and figures; numbers that are not given are empty."""
    return Shown(name, title, fill("figures.html", {"title": title, **NO_FIGURES, **numbers}))


def notes(name: str, title: str, sentences: Sequence[str], *, folded: bool = False) -> Shown | None:
    """A section that lists sentences; `None` without any."""
    if not sentences:
        return None
    return Shown(name, title, fill("notes.html", {"notes": sentences}), folded)


def inspected_page(title: str, robot: str, sections: Iterable[Shown | None]) -> str:
    """The page of what was found in logs, as HTML text, to be written as UTF-8."""
    shown = [one for one in sections if one is not None]
    return page_of(title, robot, "inspected", installed("steelyard"), shown)


def page_of(
    title: str, robot: str, made: str, version: str | None, sections: Sequence[Shown]
) -> str:
    """A page of sections as HTML text; `made` by which version of steelyard, if any."""
    page = fill(
        "page.html",
        {
            "title": title,
            "robot": robot,
            "made": made,
            "version": version,
            "sections": sections,
            "plots": any('class="plot"' in one.body or PICTURE in one.body for one in sections),
            "style": verbatim("style.css"),
            "script": verbatim("page.js"),
            "plotly": plotly_archive,
        },
    )
    return str(page)
