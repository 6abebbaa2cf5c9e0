"""What a study says: text, tables and pictures, as one HTML page and as Markdown."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path

import numpy as np
from studies.support.picture import Picture


@dataclass(frozen=True)
class Text:
    """A heading, if any, and paragraphs in plain words.

    Attributes:
        heading: Above the paragraphs; empty for none.
        paragraphs: One text each.
    """

    heading: str
    paragraphs: tuple[str, ...]


@dataclass(frozen=True)
class Code:
    """Lines as they are typed.

    Attributes:
        text: The lines.
    """

    text: str


@dataclass(frozen=True)
class Table:
    """A table; by default the paper's value, its method on our robot, and ours.

    Attributes:
        title: What the rows are of.
        rows: Cells, as many as there are columns.
        columns: Headings; the first one is of the quantity.
    """

    title: str
    rows: tuple[tuple[str, ...], ...]
    columns: tuple[str, ...] = ("", "paper", "the paper's method here", "ours")

    def __post_init__(self) -> None:
        short = [row for row in self.rows if len(row) != len(self.columns)]
        if short:
            raise ValueError(f"a row of '{self.title}' lacks cells or has too many: {short[0]}")

    def lines(self) -> str:
        """The table for a terminal."""
        every = (self.columns, *self.rows)
        widths = [max(len(row[k]) for row in every) for k in range(len(self.columns))]
        made = [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in every
        ]
        return "\n".join([self.title, made[0], "─" * max(map(len, made)), *made[1:]])


@dataclass(frozen=True)
class Claim:
    """A figure that the study claims, with its bound.

    Attributes:
        name: What is claimed.
        value: What was measured, with its unit.
        bound: What it is compared with.
        holds: Whether it holds.
    """

    name: str
    value: str
    bound: str
    holds: bool


Part = Text | Code | Table | Picture


@dataclass(frozen=True)
class Section:
    """A part of a page with bounds of its own.

    Attributes:
        parts: In this order.
        claims: Figures with bounds.
    """

    parts: tuple[Part, ...]
    claims: tuple[Claim, ...] = ()


OF_SEEDS = Text(
    "",
    (
        "Where the seeds differ, tables give the median and in brackets the least and the greatest "
        "value.",
    ),
)
"""How tables sum up the seeds, after the first text of every page."""


@dataclass(frozen=True)
class Page:
    """All that a study says.

    Attributes:
        title: Its title.
        parts: In this order.
        claims: Figures with bounds, shown as the last table.
    """

    title: str
    parts: tuple[Part, ...]
    claims: tuple[Claim, ...]

    def with_section(self, section: Section | None) -> "Page":
        """The page with a section at its end, if any."""
        if section is None:
            return self
        parts, claims = (*self.parts, *section.parts), (*self.claims, *section.claims)
        return replace(self, parts=parts, claims=claims)

    @property
    def shown(self) -> tuple[Part, ...]:
        """All parts, and the claims as a table."""
        rows = tuple((c.name, c.value, c.bound, "yes" if c.holds else "NO") for c in self.claims)
        bounds = Table("Bounds", rows, ("", "measured", "bound", "holds"))
        return (*self.parts[:1], OF_SEEDS, *self.parts[1:], bounds)

    def lines(self) -> str:
        """The tables for a terminal."""
        return "\n\n".join(part.lines() for part in self.shown if isinstance(part, Table))

    def write(self, folder: Path, name: str) -> None:
        """Write `NAME.html`, `NAME.md`, and one SVG file per picture.

        Args:
            folder: Where; it is there.
            name: Begins the names of all files.
        """
        body = "\n".join(_html(part) for part in self.shown)
        page = _SKELETON.format(title=escape(self.title), body=body)
        (folder / f"{name}.html").write_text(page, encoding="utf-8")
        parts = [f"# {self.title}", *(_markdown(part, name) for part in self.shown)]
        (folder / f"{name}.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
        for part in self.parts:
            if isinstance(part, Picture):
                (folder / f"{name}-{part.name}.svg").write_text(part.svg(), encoding="utf-8")


def over_seeds(values: Sequence[float], unit: str = "", digits: int = 3) -> str:
    """Median and range of what the seeds gave, such as `29.3 (27.1 to 31.0)`.

    Args:
        values: One per seed; NaN where a seed has none.
        unit: Behind the numbers.
        digits: Significant ones.
    """
    known = [value for value in values if np.isfinite(value)]
    if not known:
        return "in no seed"
    behind = f" {unit}" if unit else ""
    behind += f", in {len(known)} of {len(values)} seeds" * (len(known) < len(values))
    middle = f"{np.median(known):.{digits}g}"
    if len(values) == 1:
        return middle + behind
    return f"{middle} ({min(known):.{digits}g} to {max(known):.{digits}g}){behind}"


def above(values: Sequence[float], bound: float) -> str:
    """Seeds whose value is above a bound, as words behind `over_seeds`; empty if none is."""
    seeds = [f"seed {seed}: {value:.3g}" for seed, value in enumerate(values) if value > bound]
    return f"; above in {', '.join(seeds)}" if seeds else ""


def _cells(row: Sequence[str], tag: str, shown: Callable[[str], str] = escape) -> str:
    return "<tr>" + "".join(f"<{tag}>{shown(cell)}</{tag}>" for cell in row) + "</tr>"


def _html(part: Part) -> str:
    if isinstance(part, Text):
        head = f"<h2>{escape(part.heading)}</h2>" if part.heading else ""
        return head + "".join(f"<p>{escape(text)}</p>" for text in part.paragraphs)
    if isinstance(part, Code):
        return f"<pre>{escape(part.text)}</pre>"
    if isinstance(part, Table):
        rows = "".join(_cells(row, "td") for row in part.rows)
        head = f"<h3>{escape(part.title)}</h3>"
        return f"{head}<div class=wide><table>{_cells(part.columns, 'th')}{rows}</table></div>"
    return f"<figure>{part.svg()}<figcaption>{escape(part.caption)}</figcaption></figure>"


def _markdown(part: Part, name: str) -> str:
    if isinstance(part, Text):
        head = [f"## {part.heading}"] if part.heading else []
        return "\n\n".join([*head, *part.paragraphs])
    if isinstance(part, Code):
        return f"```sh\n{part.text}\n```"
    if isinstance(part, Table):
        rows = [part.columns, ("---",) * len(part.columns), *part.rows]
        lines = ["| " + " | ".join(c.replace("|", "\\|") for c in row) + " |" for row in rows]
        return "\n".join([f"### {part.title}", "", *lines])
    return f"![{part.caption}]({name}-{part.name}.svg)\n\n*{part.caption}*"


_SKELETON = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1"><title>{title}</title>
<style>
body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem;
  color: #1b1f24; background: #fff }}
h2 {{ margin-top: 2.2rem }} h3 {{ margin: 1.8rem 0 .5rem }}
.wide {{ overflow-x: auto }}
table {{ border-collapse: collapse; font-size: .93rem }}
th, td {{ text-align: left; padding: .3rem .8rem .3rem 0; border-bottom: 1px solid #d6dbe1;
  vertical-align: top }}
figure {{ margin: 1.5rem 0 }} figure svg {{ width: 100%; height: auto }}
figcaption {{ color: #4a525c; font-size: .93rem }}
</style></head><body>
<h1>{title}</h1>
{body}
</body></html>
"""
