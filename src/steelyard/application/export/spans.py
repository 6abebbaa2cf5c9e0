"""Where the elements of an XML file stand in it, so that parts of it can be replaced."""

import codecs
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from steelyard.errors import ModelError
from steelyard.robot.xml_reader import read_bytes, read_xml

_TAG = re.compile(rb"<(?:[^<>\"']|\"[^\"]*\"|'[^']*')*>")


@dataclass
class Span:
    """An element and its bytes.

    Attributes:
        tag: Its name.
        attributes: Name to text.
        start: First byte of the opening tag.
        inside: First byte after the opening tag.
        stop: First byte after the element.
        children: Elements inside, in order.
    """

    tag: str
    attributes: dict[str, str]
    start: int
    inside: int
    stop: int = 0
    children: list["Span"] = field(default_factory=list)

    def all(self, tag: str) -> list["Span"]:
        """Children of that tag."""
        return [child for child in self.children if child.tag == tag]


class Edit(NamedTuple):
    """New text for the bytes from `start` to before `stop`."""

    start: int
    stop: int
    text: str


def spans_of(path: Path) -> tuple[bytes, Span]:
    """An XML file's content without byte order mark, and its outermost element.

    Raises:
        ModelError: The file is not XML that can be read safely, or not UTF-8.
    """
    from defusedxml.ElementTree import DefusedXMLParser

    read_xml(path)
    content = read_bytes(path, "a URDF").removeprefix(codecs.BOM_UTF8)
    _refuse_other_encodings(path, content)
    builder = _Builder(content)
    parser: Any = DefusedXMLParser(target=builder)
    builder.expat = parser.parser
    parser.feed(content)
    return content, parser.close()


def edited(content: bytes, edits: Iterable[Edit]) -> str:
    """The content with parts replaced, its line ends kept."""
    newline = "\r\n" if b"\r\n" in content else "\n"
    for start, stop, text in sorted(edits, reverse=True):
        new = text.replace("\n", newline).encode("utf-8")
        content = content[:start] + new + content[stop:]
    return content.decode("utf-8")


def with_indent(content: bytes, start: int) -> int:
    """Where the line begins that only blanks precede at `start`; `start` if there is more."""
    before = content[:start].rstrip(b" \t")
    return len(before) if before.endswith(b"\n") else start


def indent_at(content: bytes, start: int) -> str:
    """The blanks before `start`."""
    line = content[content.rfind(b"\n", 0, start) + 1 : start]
    return line.decode("utf-8") if not line.strip() else ""


class _Builder:
    """Target of the parser: asks the parser for the place of every tag."""

    def __init__(self, content: bytes) -> None:
        self.content = content
        self.expat: Any = None
        self.open: list[Span] = []
        self.root: Span | None = None

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        start = self.expat.CurrentByteIndex
        found = _TAG.match(self.content, start)
        inside = found.end() if found else start
        span = Span(tag, dict(attributes), start, inside)
        if self.open:
            self.open[-1].children.append(span)
        else:
            self.root = span
        self.open.append(span)

    def end(self, tag: str) -> None:
        span = self.open.pop()
        empty = self.content[span.inside - 2 : span.inside] == b"/>"
        place = self.expat.CurrentByteIndex
        span.stop = span.inside if empty else self.content.index(b">", place) + 1

    def close(self) -> Span | None:
        return self.root


def _refuse_other_encodings(path: Path, content: bytes) -> None:
    declared = re.match(rb"<\?xml[^>]*encoding\s*=\s*[\"']([\w.-]+)", content)
    name = declared.group(1).decode().lower() if declared else "utf-8"
    try:
        content.decode("utf-8")
        known = name in ("utf-8", "us-ascii", "ascii") or content.isascii()
    except UnicodeDecodeError:
        known = False
    if not known:
        raise ModelError(
            f"the file is not UTF-8 (it says {name})",
            where=str(path),
            fix="save a copy as UTF-8 and give that",
        )
