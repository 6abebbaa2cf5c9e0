"""A robot's own URDF with the numbers of an identified model in their places.

In a robot's own URDF meshes, comments and layout stay. The numbers of a moving link are those of
all that moves with it, so links fixed to it lose their own; joints that were locked for the
identification become fixed ones, where they were locked.
"""

import codecs
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.parsers.expat import ParserCreate

from steelyard.base.errors import ModelError, advice
from steelyard.export.model_files.representable_content import Content, carriers_of
from steelyard.export.model_files.urdf_and_mjcf import comment, dynamics_of, inertial_of, origin_of
from steelyard.robot.file.model_reading_and_loaded_robot import read_mechanism
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import Placement
from steelyard.robot.models.xacro import expand, split_reference
from steelyard.robot.models.xml_and_urdf import read_bytes, read_xml
from steelyard.robot.robot import Frame, Robot

_TAG = re.compile(rb"<(?:[^<>\"']|\"[^\"]*\"|'[^']*')*>")


@dataclass
class Span:
    """An element and its bytes."""

    tag: str
    attributes: dict[str, str]
    start: int  # first byte of the opening tag
    inside: int  # first byte after the opening tag
    stop: int = 0  # first byte after the element
    children: list["Span"] = field(default_factory=list)  # elements inside, in order

    def all(self, tag: str) -> list["Span"]:
        """Children of that tag."""
        return [child for child in self.children if child.tag == tag]


class Edit(NamedTuple):
    """New text for the bytes from `start` to before `stop`."""

    start: int
    stop: int
    text: str


def spans_of(path: Path) -> tuple[bytes, Span]:
    """An XML file's content without byte order mark, and its outermost element."""
    read_xml(path)
    content = read_bytes(path, "a URDF").removeprefix(codecs.BOM_UTF8)
    _refuse_other_encodings(path, content)
    # plain expat: `read_xml` has refused entities
    parser, opened, root = ParserCreate(), list[Span](), Span("", {}, 0, 0)

    def start(tag: str, attributes: dict[str, str]) -> None:
        place = parser.CurrentByteIndex
        found = _TAG.match(content, place)
        span = Span(tag, dict(attributes), place, found.end() if found else place)
        (opened[-1] if opened else root).children.append(span)
        opened.append(span)

    def end(_: str) -> None:
        span = opened.pop()
        empty = content[span.inside - 2 : span.inside] == b"/>"
        last = parser.CurrentByteIndex
        span.stop = span.inside if empty else content.index(b">", last) + 1

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(content, True)
    return content, root.children[0]


def edited(content: bytes, edits: Iterable[Edit]) -> str:
    """The content with parts replaced, its line ends kept."""
    newline = "\r\n" if b"\r\n" in content else "\n"
    for start, stop, text in sorted(edits, reverse=True):
        new = text.replace("\n", newline).encode("utf-8")
        content = content[:start] + new + content[stop:]
    return content.decode("utf-8")


def indent_at(content: bytes, start: int) -> str:
    """The blanks before `start`."""
    line = content[content.rfind(b"\n", 0, start) + 1 : start]
    return line.decode("utf-8") if not line.strip() else ""


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


MOVING_JOINT_ELEMENTS = ("axis", "limit", "mimic", "dynamics", "safety_controller", "calibration")
"""What only joints that move have."""


def urdf_behind(path: Path) -> Path:
    """The URDF that is meant: the file, the one that a robot file names, or an expanded one."""
    if path.suffix.lower() == ".toml":
        path = load_robot(path).sources[-1].path
    elif expansion := expand(*split_reference(path)):
        path = expansion.path
    tag = None if path.suffix.lower() == ".toml" else spans_of(path)[1].tag
    if tag != "robot":
        raise ModelError(
            "there is no URDF to insert the values into",
            where=str(path),
            fix="give the robot's URDF, or leave out --model: a new file is then written",
        )
    return path


def urdf_with(content: Content, path: Path, head: str) -> str:
    """The text of a URDF with the numbers of a model."""
    mechanism = read_mechanism(path)
    original, root = spans_of(path)
    _refuse_stranger(content, root, path)
    moving = _joints(content.robot)
    carrying = {j.name for name in moving for j in mechanism.to_link(mechanism.joint(name).child)}
    editing = _Editing(content, original, frozenset(carrying))
    edits = [Edit(root.start, root.start, f"{head}\n")]
    edits += [edit for link in root.all("link") for edit in editing.link(link)]
    edits += [edit for joint in root.all("joint") for edit in editing.joint(joint)]
    return edited(original, edits)


def _refuse_stranger(content: Content, root: Span, path: Path) -> None:
    robot = content.robot
    for tag, wanted in (
        ("link", [*(b.name for b in robot.bodies), *(f.name for f in robot.frames)]),
        ("joint", _joints(robot)),
    ):
        there = [span.attributes.get("name", "") for span in root.all(tag)]
        for name in wanted:
            if name not in there:
                raise ModelError(
                    f"the file has no {tag} '{name}', which the identified model has",
                    where=str(path),
                    fix=f"give the URDF that the robot was identified with; "
                    f"{advice(name, there, tag + 's')}",
                )


def _joints(robot: Robot) -> list[str]:
    """Names of the joints that carry bodies."""
    return [body.joint for body in robot.bodies if body.kind != "floating"]


@dataclass(frozen=True)
class _Editing:
    """What changes in one file; `carrying` are the joints that carry moving links."""

    content: Content
    original: bytes
    carrying: frozenset[str]

    def link(self, link: Span) -> list[Edit]:
        """A moving link gets the numbers; one that is fixed to it loses its own."""
        robot, name = self.content.robot, link.attributes["name"]
        bodies = [body.name for body in robot.bodies]
        if name in bodies:
            inertial = inertial_of(self.content.inertias[bodies.index(name)])
            return self._put(link, "inertial", inertial)
        frame = self._frame(name)
        if frame is None or frame.body < 0:
            return []
        words = f"mass and inertia are among those of '{bodies[frame.body]}'"
        return [Edit(old.start, old.stop, _note(words)) for old in link.all("inertial")]

    def joint(self, joint: Span) -> list[Edit]:
        """A joint of the model gets its friction; one that was locked is fixed."""
        robot, name = self.content.robot, joint.attributes["name"]
        joints = [body.joint for body in robot.bodies]
        if name in joints:
            index = joints.index(name)
            coordinate = robot.bodies[index].coordinate
            own = carriers_of(robot)[coordinate] == index
            effects = self.content.joints[coordinate] if own else {}
            return self._put(joint, "dynamics", *dynamics_of(effects))
        parent, child = (
            self._frame(joint.all(end)[0].attributes["link"]) for end in ("parent", "child")
        )
        if joint.attributes["type"] == "fixed" or parent is None or child is None:
            return []
        free = child.body < 0 and name not in self.carrying
        return [] if free else self._locked(joint, parent, child)

    def _frame(self, name: str) -> Frame | None:
        return next((f for f in self.content.robot.frames if f.name == name), None)

    def _locked(self, joint: Span, parent: Frame, child: Frame) -> list[Edit]:
        tag = self.original[joint.start : joint.inside].decode("utf-8")
        fixed = re.sub(r"""(\stype\s*=\s*)("[^"]*"|'[^']*')""", r'\1"fixed"', tag)
        words = f"was {joint.attributes['type']}; locked at its position in the identification"
        there = Placement(parent.rotation, parent.position)
        back = Placement(there.rotation.T, -there.rotation.T @ there.position)
        place = back @ Placement(child.rotation, child.position)
        edits = [Edit(joint.start, joint.inside, f"{fixed}{_note(words)}")]
        edits += [self._removed(x) for tag in MOVING_JOINT_ELEMENTS for x in joint.all(tag)]
        return edits + self._put(joint, "origin", origin_of(place.rotation, place.position))

    def _put(self, parent: Span, tag: str, *new: ET.Element) -> list[Edit]:
        """Elements in the place of those of a tag; where there are none, as the last ones."""
        old = parent.all(tag)
        if not new:
            return [self._removed(span) for span in old]
        if old:
            indent = indent_at(self.original, old[0].start)
            return [Edit(old[0].start, old[0].stop, _text(new, indent))]
        outer = indent_at(self.original, parent.start)
        indent = outer + "  "
        if parent.children:
            indent = indent_at(self.original, parent.children[0].start) or indent
            last = parent.children[-1].stop
            return [Edit(last, last, f"\n{indent}{_text(new, indent)}")]
        text = f"\n{indent}{_text(new, indent)}\n{outer}"
        if parent.stop > parent.inside:
            return [Edit(parent.inside, parent.inside, text)]
        opening = self.original[parent.start : parent.inside].decode("utf-8")
        return [Edit(parent.start, parent.stop, f"{opening[:-2].rstrip()}>{text}</{parent.tag}>")]

    def _removed(self, span: Span) -> Edit:
        """An element and, if it has its lines for itself, the line end before them."""
        before = self.original[: span.start].rstrip(b" \t")
        after = self.original[span.stop :].lstrip(b" \t")[:1]
        if not before.endswith(b"\n") or after not in (b"\r", b"\n"):
            return Edit(span.start, span.stop, "")
        return Edit(len(before.removesuffix(b"\n").removesuffix(b"\r")), span.stop, "")


def _text(elements: tuple[ET.Element, ...], indent: str) -> str:
    """Elements as text, the first line without indent."""

    def lines() -> Iterator[str]:
        for element in elements:
            ET.indent(element)
            yield from ET.tostring(element, encoding="unicode").splitlines()

    return f"\n{indent}".join(lines())


def _note(words: str) -> str:
    return " ".join(comment(words).split())
