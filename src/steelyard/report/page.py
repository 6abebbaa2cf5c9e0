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
from markupsafe import Markup

from steelyard.base.arrays import Array
from steelyard.base.templates import templates_of
from steelyard.report import words
from steelyard.report.tables import PlainTable, text_table

if TYPE_CHECKING:
    from jinja2 import Environment
    from rich.console import RenderableType

TEMPLATES = Path(__file__).parent / "templates"
PLOTLY = Path(__file__).parent / "plotly" / "plotly.min.js.gz"
"""The parts that pages use, compressed. The version is in `source.json` beside it;
`tools/update_browser_script.py` replaces it."""

PICTURE = 'class="picture'  # what marks a picture in the page


@cache
def _environment() -> Environment:
    """Templates that escape everything: names come from files of strangers."""
    environment = templates_of(TEMPLATES, autoescape=True)
    own = (words.significant, words.percent, words.share, words.relative, words.kept, breakable)
    environment.filters |= {function.__name__: function for function in own}
    environment.filters["alike"] = words.rounded_to_uncertainty
    environment.globals["count"] = words.count
    return environment


def fill(template: str, values: Mapping[str, Any]) -> str:
    """A template of this room filled with values, as safe HTML."""
    return Markup(_environment().get_template(template).render(values))


def breakable(name: str) -> str:
    """A name as safe HTML that may be broken behind dots and underscores, never inside a word."""
    return Markup("<wbr>").join(words.pieces(name))


def verbatim(name: str) -> str:
    """A style sheet or script of this room, to stand in a page as it is."""
    return Markup((TEMPLATES / name).read_text(encoding="utf-8"))


def script_json(value: object) -> str:
    """JSON that cannot end the script element it stands in."""
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


Numbers = Mapping[str, Any]  # everything a section's template shows, by name
LabelledValues = Sequence[tuple[str, str]]  # labels and values, ready to be read

EMPTY: Numbers = {"words": "", "tables": (), "folded": "", "legend": (), "groups": (), "note": ""}
"""What stands for numbers of figures and tables that a section does not have."""


@dataclass(frozen=True)
class PageContent:
    """What the page of any job shows beside its own values."""

    title: str
    robot: str
    # per run its name and, labelled, what was found in its log
    qualities: tuple[tuple[str, LabelledValues], ...] = ()
    notes: tuple[str, ...] = ()  # what was assumed or is doubtful, for people to read
    details: tuple[str, ...] = ()  # what else was decided, such as cut-offs and corrected rows
    settings: LabelledValues = ()  # what the results depend on, labelled


class Section(ABC):
    """One section of a page, over the content of the page."""

    name: ClassVar[str]
    title: ClassVar[str]
    template: ClassVar[str]  # what shows its numbers
    folded: ClassVar[bool] = False  # whether the page shows its heading alone until a click

    def __init_subclass__(cls, **given: Any) -> None:
        """The attributes of a section are the keywords of its class."""
        for key, value in given.items():
            setattr(cls, key, value)

    @abstractmethod
    def numbers(self, content: Any) -> Numbers | None:
        """What there is to show; `None` leaves the section out."""

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill(self.template, {"title": self.title, **EMPTY, **numbers})

    def to_dict(self, content: Any) -> dict[str, Any]:
        """Fields of `--json`; they are there, and `None`, where there is nothing to show."""
        return {}

    def printed(self, content: Any) -> Iterable[RenderableType]:
        """What the terminal shows, an empty line before each."""
        return ()

    def detailed(self, content: Any) -> Iterable[RenderableType]:
        """What the terminal shows below that with `--verbose`."""
        return ()


class TableSection(Section, template="tables.html"):
    """A section that is plain tables."""

    in_terminal: ClassVar[bool] = False
    """Whether the terminal shows them with `--verbose`."""

    @abstractmethod
    def tables(self, content: Any) -> Sequence[PlainTable]:
        """The tables; none leaves the section out."""

    def numbers(self, content: Any) -> Numbers | None:
        """The tables, if there are some."""
        tables = self.tables(content)
        return {"tables": tables} if tables else None

    def detailed(self, content: Any) -> Iterable[RenderableType]:
        """The tables, if the terminal shows them."""
        if self.in_terminal:
            yield from (text_table(table, self.title) for table in self.tables(content))


class ValueSection(TableSection):
    """Plain tables of one value of the content, which are left out where it is `None`."""

    value: ClassVar[str]  # the attribute of the content, and the value's field of `--json`

    @abstractmethod
    def tables_of(self, found: Any, content: Any) -> Sequence[PlainTable]:
        """The tables of the value."""

    def tables(self, content: Any) -> Sequence[PlainTable]:
        """The tables, if there is the value."""
        found = getattr(content, self.value)
        return () if found is None else self.tables_of(found, content)

    def to_dict(self, content: Any) -> dict[str, Any]:
        """The value."""
        found = getattr(content, self.value)
        return {self.value: None if found is None else found.to_dict()}


class FigureSection(Section, template="figures.html"):
    """A section that is figures, with words and tables."""


@dataclass(frozen=True)
class Shown:
    """A section of a page as safe HTML."""

    name: str
    title: str
    body: str
    folded: bool = False


def render_sections(
    sections: Iterable[Section], content: PageContent, made: str, by: str | None = None
) -> str:
    """The page of the sections that have something to show, see `page_of`."""
    shown = [
        Shown(section.name, section.title, section.show(numbers), section.folded)
        for section in sections
        if (numbers := section.numbers(content)) is not None
    ]
    return page_of(content.title, content.robot, shown, made, by)


def figures(name: str, title: str, **numbers: Any) -> Shown:
    """A section of words, tables and figures; numbers that are not given are empty."""
    return Shown(name, title, fill("figures.html", {"title": title, **EMPTY, **numbers}))


def notes(name: str, title: str, sentences: Sequence[str], *, folded: bool = False) -> Shown | None:
    """A section that lists sentences; `None` without any."""
    if not sentences:
        return None
    return Shown(name, title, fill("notes.html", {"notes": sentences}), folded)


def page_of(
    title: str,
    robot: str,
    sections: Iterable[Shown | None],
    made: str = "inspected",
    by: str | None = None,
) -> str:
    """A page of sections as HTML text, to be written as UTF-8.

    `made` says what was done, such as `identified`, `by` which version of steelyard, this one if
    `None`.
    """
    shown = [one for one in sections if one is not None]
    page = fill(
        "page.html",
        {
            "title": title,
            "robot": robot,
            "made": made,
            "version": by or installed("steelyard"),
            "sections": shown,
            "plots": any('class="plot"' in one.body or PICTURE in one.body for one in shown),
            "style": verbatim("style.css"),
            "script": verbatim("page.js"),
            "plotly": lambda: base64.b64encode(PLOTLY.read_bytes()).decode(),
        },
    )
    return str(page)
