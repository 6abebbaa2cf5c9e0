"""An identified model as a URDF or MJCF file: what the format cannot represent, a robot's own URDF.

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

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import ModelError, OutputError, advice
from steelyard.base.files import whole_file
from steelyard.check.fitted.implausible_estimates import light_links
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.export.model_files.representable_content import (
    FORMAT_NAMES,
    Content,
    Format,
    base_of,
    carriers_of,
    content_of,
)
from steelyard.export.model_files.urdf_and_mjcf import (
    comment,
    document,
    dynamics_of,
    head_of,
    inertial_of,
    mjcf_of,
    origin_of,
    urdf_of,
)
from steelyard.robot.file.model_reading_and_loaded_robot import read_mechanism
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Placement
from steelyard.robot.mechanism import Mechanism
from steelyard.robot.models.xacro import expand, split_reference
from steelyard.robot.models.xml_reader import read_bytes, read_xml
from steelyard.robot.robot import Body, Frame, Robot
from steelyard.robot.robot_from_mechanism import reduced

LEAST_DATA_SHARE = 0.005  # share from the data below which they do not show a parameter


def _impossible_kept(content: Content, original: Path) -> tuple[str, ...]:
    """Links that keep what a URDF says, and cannot exist as it says; one sentence each."""
    robot = content.robot
    carried = {body.name for body in robot.bodies}
    carried |= {frame.name for frame in robot.frames if frame.body >= 0}
    return tuple(
        f"{link.name}: {flaw}"
        for link in read_mechanism(original).links
        if link.inertia is not None and link.name not in carried and (flaw := link.inertia.flaw())
    )


REREAD_TOLERANCE = 1e-9  # how far numbers may move by being reread, relative to the largest

MERGED = "Links fixed to a moving link, directly or by locked joints, are lumped into that link."

SHARES = "Share of each link's mass that comes from the data, the rest is prior:"
UNSEEN = "Not identifiable from the data:"
LIGHT_LINKS = "Implausibly light, do not rely on the mass of one of these links:"
KEPT = "Links that were not identified and are not physically consistent in the original file:"


@dataclass(frozen=True)
class Exported:
    """The text of a model file."""

    text: str
    form: Format
    unsupported: tuple[str, ...]  # what of the model the format does not support, one sentence each
    content: Content
    mass_shares: dict[str, float]  # per link the share of its mass that comes from the data, 0 to 1
    unseen: tuple[str, ...]  # parameters that the data did not see
    impossible: tuple[str, ...] = ()  # links that cannot exist as the original says, and are kept
    light: tuple[str, ...] = ()  # links that are implausibly light, one sentence each


def exported(
    identified: IdentifiedModel, form: Format, original: str | Path | None = None
) -> Exported:
    """A model as the text of a file."""
    content, estimate = content_of(identified, form), identified.estimate
    learned, bodies = {}, content.robot.bodies
    if estimate.standard is not None:
        names = estimate.standard.parameters.names
        learned = dict(zip(names, estimate.standard.learned.tolist(), strict=True))
    shares = {body.name: learned[f"m.{body.name}"] for body in bodies if not body.massless}
    of_bodies = {f"{number}.{body.name}" for number in INERTIAL_NAMES for body in bodies}
    beside = [n for n, x in learned.items() if x < LEAST_DATA_SHARE and n not in of_bodies]
    unseen = tuple(dict.fromkeys((*(blind.name for blind in estimate.blind), *beside)))
    more = listed_under(SHARES, (f"{name}: {share:.0%}" for name, share in shares.items()))
    more += listed_under(UNSEEN, unseen)
    impossible, light = tuple[str, ...](), light_links(identified)
    more += listed_under(LIGHT_LINKS, light)
    if original is None:
        root = urdf_of(content) if form == "urdf" else mjcf_of(content)
        text = document(root, head_of(identified, content, form, more))
    elif form == "urdf":
        path = urdf_behind(Path(original))
        impossible = _impossible_kept(content, path)
        more = [MERGED, *more, *listed_under(KEPT, impossible)]
        text = urdf_with(content, path, head_of(identified, content, form, more))
    else:
        raise ModelError(
            f"values can be inserted into a URDF, not into {FORMAT_NAMES[form]}",
            where=str(original),
            fix="leave out --model, or export to a URDF",
        )
    return Exported(text, form, content.unsupported, content, shares, unseen, impossible, light)


def listed_under(heading: str, sentences: Iterable[str]) -> list[str]:
    """Lines of a list, none if it is empty."""
    lines = [f"  - {sentence}" for sentence in sentences]
    return [heading, *lines] if lines else []


def refuse_changed(path: Path, made: Exported) -> None:
    """Read a file that was written, and compare all bodies with those it was to hold."""
    wanted, inertias = made.content.robot, made.content.inertias
    found = _reread(path, wanted, made.form)
    for index, body in enumerate(wanted.bodies):
        names = [other.name for other in found.bodies]
        other = found.bodies[names.index(body.name)] if body.name in names else None
        ten = inertias[index].ten
        if other is None or _names(wanted, body) != _names(found, other):
            what = "has another parent link or joint"
        elif not _alike(_place(body), _place(other)):
            what = "has another pose or axis"
        elif not other.massless and not _alike(ten, other.inertia.ten):
            what = "has another mass or inertia"
        else:
            continue
        raise ModelError(
            f"link '{body.name}' {what} in the file than in the identified model",
            where=f"export of '{wanted.name}' to {FORMAT_NAMES[made.form]}",
            fix="give the URDF that the robot was identified with, or leave out --model",
        )


def _reread(path: Path, wanted: Robot, form: Format) -> Robot:
    """The robot of a file, as a tree with the joints of another, its angles snapped or not."""
    there = read_mechanism(path)
    tree = Mechanism(there.name, there.links, there.joints, there.gravity, there.where)
    base = base_of(wanted) if form == "urdf" else None
    names = [c.name for c in wanted.joints]
    snapped, exact = (reduced(tree, names, base=base, snap=snap)[0] for snap in (True, False))
    pairs = zip(wanted.bodies, exact.bodies, strict=False)
    return exact if all(_alike(_place(x), _place(y)) for x, y in pairs) else snapped


def _names(robot: Robot, body: Body) -> tuple[str, ...]:
    """What a body hangs on and moves with."""
    parent = robot.bodies[body.parent].name if body.parent >= 0 else ""
    return parent, body.joint, body.kind, robot.joints[body.coordinate].name


def _place(body: Body) -> Array:
    """Where a body is on its parent, and how it moves."""
    turned = [*body.axis, *body.rotation.ravel()]
    return np.array([body.ratio, body.offset, *body.position, *turned])


def _alike(one: Array, other: Array) -> bool:
    return bool(np.abs(one - other).max() <= REREAD_TOLERANCE * np.abs(one).max())


@checked()
def export(
    model: str | Path | IdentifiedModel, path: str | Path, original: str | Path | None = None
) -> tuple[str, ...]:
    """Write an identified model as URDF (`.urdf`) or MJCF (`.xml`).

    Args:
        model: The model, its `model.json`, or the folder that holds it.
        path: File to make; it must not exist.
        original: The robot's own URDF, to put the numbers into; a file of the moving bodies alone
            is made if `None`.

    Returns:
        What the format cannot represent, one sentence each.

    Raises:
        SteelyardError: The file exists, its name ends otherwise, or the model lacks parameters.

    Example:
        >>> lost = export(load_model("arm-model"), "identified.urdf")
        >>> print(lost[0].split(":")[0])
        rotor inertia
    """
    target = Path(path)
    form = {".urdf": "urdf", ".xml": "mjcf"}.get(target.suffix.lower())
    if form is None or target.exists():
        raise OutputError(
            "the file exists already" if form else f"no format of files '{target.suffix}' is known",
            where=str(target),
            fix="give the name of a new file that ends in .urdf or .xml",
        )
    made = exported(load_model(model), "urdf" if form == "urdf" else "mjcf", original)
    with whole_file(target) as part:
        part.write_text(made.text, encoding="utf-8", newline="")
        refuse_changed(part, made)
    return tuple(made.unsupported)


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


def with_indent(content: bytes, start: int) -> int:
    """Where the line begins that only blanks precede at `start`; `start` if there is more."""
    before = content[:start].rstrip(b" \t")
    return len(before) if before.endswith(b"\n") else start


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
    moving = [body.joint for body in content.robot.bodies]
    carrying = {j.name for name in moving for j in mechanism.to_link(mechanism.joint(name).child)}
    editing = _Editing(content, original, frozenset(carrying))
    edits = [Edit(root.start, root.start, f"{head}\n")]
    for link in root.all("link"):
        edits += editing.link(link)
    for joint in root.all("joint"):
        edits += editing.joint(joint)
    return edited(original, edits)


def _refuse_stranger(content: Content, root: Span, path: Path) -> None:
    robot = content.robot
    for tag, wanted in (
        ("link", [*(b.name for b in robot.bodies), *(f.name for f in robot.frames)]),
        ("joint", [body.joint for body in robot.bodies]),
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
        start = with_indent(self.original, span.start)
        alone = self.original[span.stop :].lstrip(b" \t")[:1] in (b"\r", b"\n")
        if start == span.start or not alone:
            return Edit(span.start, span.stop, "")
        before = self.original[:start]
        return Edit(len(before.removesuffix(b"\n").removesuffix(b"\r")), span.stop, "")


def _text(elements: tuple[ET.Element, ...], indent: str) -> str:
    """Elements as text, the first line without indent."""

    def lines() -> Iterator[str]:
        for element in elements:
            ET.indent(element)
            yield from ET.tostring(element, encoding="unicode").splitlines()

    return f"\n{indent}".join(lines())


def _note(words: str) -> str:
    """A comment of one line."""
    return " ".join(comment(words).split())
