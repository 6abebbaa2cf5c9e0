"""XML from strangers, read safely, each element with its line."""

import codecs
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from steelyard.base.errors import ModelError, advice, names_beside, nearest


@dataclass(frozen=True)
class Element:
    """An element with the line of its opening tag, from 1; `texts` are between the tags."""

    tag: str
    attributes: Mapping[str, str]
    path: Path
    line: int
    children: list["Element"] = field(default_factory=list)
    texts: list[str] = field(default_factory=list)

    @property
    def where(self) -> str:
        """File, line and the tag with its name, for messages."""
        name = self.attributes.get("name")
        shown = f"<{self.tag} name='{name}'>" if name else f"<{self.tag}>"
        return f"{self.path}, line {self.line}, {shown}"

    def all(self, tag: str) -> list["Element"]:
        """Children of that tag."""
        return [child for child in self.children if child.tag == tag]

    def walk(self) -> Iterator["Element"]:
        """This element and everything inside, in the order of the file."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting.extend(element.children[::-1])


def xacro_name(tag: str) -> str | None:
    """The name of an element or attribute of xacro, without its prefix; `None` for others."""
    space, _, name = tag.rpartition("}")
    return name if "xacro" in space else None


class _Builder:
    """Target of the parser: builds elements and asks the parser for their lines."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.expat: Any = None
        self.open: list[Element] = []
        self.root: Element | None = None

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self.expat.CurrentLineNumber
        element = Element(tag, MappingProxyType(dict(attributes)), self.path, line)
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)

    def data(self, text: str) -> None:
        self.open[-1].texts.append(text)

    def end(self, tag: str) -> None:
        self.open.pop()

    def close(self) -> Element | None:
        return self.root


LARGEST_MODEL_FILE = 1 << 28  # bytes of the largest model file that is read


def read_bytes(path: Path, what: str) -> bytes:
    """The content of a regular file of a bounded size; a clear error if it cannot be read."""
    fix = f"give the path of {what}"
    try:
        refuse_device(path)
        if path.stat().st_size > LARGEST_MODEL_FILE:
            raise ModelError(
                f"the file is larger than {LARGEST_MODEL_FILE >> 20} MiB", where=str(path), fix=fix
            )
        return path.read_bytes()
    except FileNotFoundError:
        wrong = "there is no such file"
        near, alike = names_beside(path)
        if meant := nearest(path.name, alike) or near:
            fix = advice(path.name, meant, "files there")
    except IsADirectoryError:
        wrong = "this is a folder, not a file"
    except OSError as error:
        wrong = f"the file cannot be read: {error.strerror}"
    raise ModelError(wrong, where=str(path), fix=fix)


def refuse_device(path: Path) -> None:
    """Refuse what is no file on a disk: a device never ends, and a pipe waits for its writer."""
    if path.exists() and not path.is_file() and not path.is_dir():
        raise ModelError(
            "this is a device or a pipe, not a file", where=str(path), fix="give the path of a file"
        )


_ROOT = re.compile(rb"\A(?:\s|<\?.*?\?>|<!--.*?-->)*<[\w.:-]+", re.DOTALL)
_PREFIX = re.compile(rb"[<\s]([A-Za-z_][\w.-]*):[A-Za-z_]")
_DECLARED = re.compile(rb"xmlns:([\w.-]+)")


def _begun(content: bytes) -> bytes:
    """The text with blank lines before the XML declaration put behind it."""
    text = content.lstrip()
    blank, end = content[: len(content) - len(text)], text.find(b"?>") + 2
    if not blank or not text.startswith(b"<?xml") or end < 2:
        return content
    return text[:end] + blank + text[end:]


def _with_prefixes(content: bytes) -> bytes:
    """The text with prefixes that it never declares, such as `drake:`, declared on its root."""
    root = _ROOT.match(content)
    missing = {*_PREFIX.findall(content)} - {*_DECLARED.findall(content), b"xml", b"xmlns"}
    if root is None or not missing:
        return content
    spaces = b"".join(b' xmlns:%s="%s"' % (name, name) for name in sorted(missing))
    return content[: root.end()] + spaces + content[root.end() :]


def read_xml(path: Path) -> Element:
    """The root element of an XML file.

    A prefix that is never declared makes a namespace of its own, and blank lines may stand before
    the declaration: ROS and Pinocchio pass over both. Entities are refused: they could grow without
    bound or reach other files.
    """
    from defusedxml.common import DefusedXmlException
    from defusedxml.ElementTree import DefusedXMLParser, ParseError

    content = read_bytes(path, "a URDF, an MJCF or a robot file (.toml)")
    builder = _Builder(path)
    parser: Any = DefusedXMLParser(target=builder)
    builder.expat = parser.parser
    try:
        parser.feed(_with_prefixes(_begun(content.removeprefix(codecs.BOM_UTF8))))
        root = parser.close()
    except DefusedXmlException:
        raise ModelError(
            "the file defines XML entities, which a robot model does not need",
            where=f"{path}, line {builder.expat.CurrentLineNumber}",
            fix="remove the <!DOCTYPE ...> with its <!ENTITY ...> lines",
        ) from None
    except (ParseError, ValueError, LookupError) as error:
        raise ModelError(
            f"the file is not valid XML: {error}",
            where=f"{path}, line {builder.expat.CurrentLineNumber}",
            fix="give a URDF or an MJCF, before the logs; if it is one, correct the XML there",
        ) from None
    if root is None:
        raise ModelError(
            "the file holds no XML", where=str(path), fix="give a URDF or an MJCF file"
        )
    return root  # type: ignore[no-any-return]
