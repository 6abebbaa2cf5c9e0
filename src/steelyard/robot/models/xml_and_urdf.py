"""XML from strangers, read safely, each element with its line; and URDF, without meshes or ROS."""

import codecs
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast, get_args

from steelyard.base.arrays import frozen
from steelyard.base.errors import ModelError, advice, names_beside, nearest, refuse_unknown
from steelyard.robot.inertia_and_placement import Inertia, Placement, rpy_rotation, symmetric
from steelyard.robot.mechanism import Joint, Link, Mechanism, MechanismJointKind, Mimic
from steelyard.robot.robot import Limits


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
        self.open = [Element("", {}, path, 0)]  # around the outermost element

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self.expat.CurrentLineNumber
        element = Element(tag, MappingProxyType(dict(attributes)), self.path, line)
        self.open[-1].children.append(element)
        self.open.append(element)

    def data(self, text: str) -> None:
        self.open[-1].texts.append(text)

    def end(self, tag: str) -> None:
        self.open.pop()

    def close(self) -> Element | None:
        return next(iter(self.open[0].children), None)


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


def read_root(path: Path, tag: str, what: str, fix: str) -> Element:
    """The root element of an XML file, which has a tag."""
    root = read_xml(path)
    if root.tag != tag:
        wrong = f"the file is not {what}: its outermost element is <{root.tag}>"
        raise ModelError(wrong, where=root.where, fix=fix)
    return root


_KINDS = tuple(kind for kind in get_args(MechanismJointKind) if kind != "ball")
_SINGLE = ("revolute", "continuous", "prismatic")
_SIX = ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")


def read_urdf(path: Path) -> Mechanism:
    """The mechanism of a URDF file, which is a tree of joints.

    Visuals, collisions and unknown elements are passed over. `rpy` is
    $R_z(y) R_y(p) R_x(r)$; the rotation of an inertial's origin turns its tensor; a joint
    without `<axis>` moves about x; a mass without `<inertia>` is a point. A speed limit of zero
    means that it is unknown.
    """
    fix = "give a URDF (<robot>), an MJCF (<mujoco>) or a robot file (.toml)"
    root = read_root(path, "robot", "a URDF", fix)
    if (element := of_xacro(root)) is not None:
        raise ModelError(
            "the file is a xacro template, not a URDF",
            where=f"{element.path}, line {element.line}",
            fix="give the whole xacro file, which is expanded here, or expand it first: "
            f"xacro {element.path.name} > robot.urdf",
        )
    return Mechanism(
        root.attributes.get("name") or path.stem,
        [_link(element) for element in root.all("link")],
        [_joint(element) for element in root.all("joint")],
        where=str(path),
    )


def of_xacro(root: Element) -> Element | None:
    """The first element that xacro has to expand, but for visuals, collisions and plug-ins."""
    for element in root.children:
        used = [element] if xacro_name(element.tag) is not None else []
        if element.tag == "link":
            used = [element, *(x for part in element.all("inertial") for x in part.walk())]
        elif element.tag == "joint":
            used = list(element.walk())
        for part in used:
            values = part.attributes.values()
            if xacro_name(part.tag) is not None or any("${" in v or "$(" in v for v in values):
                return part
    return None


def _text(element: Element, attribute: str) -> str:
    value = element.attributes.get(attribute, "").strip()
    if not value:
        raise ModelError(
            f"<{element.tag}> has no attribute '{attribute}'",
            where=element.where,
            fix=f'write <{element.tag} {attribute}="...">',
        )
    return value


def numbers_of(
    element: Element,
    attribute: str,
    count: int,
    default: Sequence[float] | None = None,
    infinite: bool = False,
) -> Sequence[float]:
    """The numbers of an attribute, `count` of them; the default, if any, where it is absent."""
    if default is not None and attribute not in element.attributes:
        return default
    text = _text(element, attribute)
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    good = [not math.isnan(v) and (infinite or math.isfinite(v)) for v in values]
    if len(values) != count or not all(good):
        wanted = "a finite number" if count == 1 else f"{count} finite numbers"
        raise ModelError(
            f'{attribute}="{text}" of <{element.tag}> is not {wanted}',
            where=element.where,
            fix=f'write {attribute}="' + " ".join(["0.0"] * count) + '" with your values',
        )
    return values


def number_of(
    element: Element, attribute: str, default: float | None = None, infinite: bool = False
) -> float:
    """The number of an attribute; the default, if any, where it is absent."""
    given = None if default is None else [default]
    return numbers_of(element, attribute, 1, given, infinite)[0]


def _only(parent: Element, tag: str) -> Element | None:
    found = parent.all(tag)
    if len(found) > 1:
        raise ModelError(
            f"<{parent.tag}> has {len(found)} <{tag}> elements",
            where=found[1].where + f" in {parent.where.rsplit(', ', 1)[1]}",
            fix="keep one of them",
        )
    return found[0] if found else None


def _needed(parent: Element, tag: str) -> Element:
    child = _only(parent, tag)
    if child is None:
        raise ModelError(
            f"<{parent.tag}> has no <{tag}> element", where=parent.where, fix=f"add a <{tag}> to it"
        )
    return child


def placement_of(parent: Element) -> Placement:
    """Where the `<origin>` of an element is."""
    origin = _only(parent, "origin")
    if origin is None:
        return Placement()
    xyz, rpy = (numbers_of(origin, name, 3, (0.0, 0.0, 0.0)) for name in ("xyz", "rpy"))
    return Placement(rpy_rotation(*rpy), xyz)


def _link(element: Element) -> Link:
    name = _text(element, "name")
    inertial = _only(element, "inertial")
    if inertial is None:
        return Link(name, None, element.where)
    mass = number_of(_needed(inertial, "mass"), "value")
    tensor = _only(inertial, "inertia")
    about_com = symmetric([0.0 if tensor is None else number_of(tensor, six) for six in _SIX])
    placement = placement_of(inertial)
    inertia = Inertia.about_com(mass, (0.0, 0.0, 0.0), about_com)
    return Link(name, inertia.moved(placement.rotation, placement.position), element.where)


def _joint(element: Element) -> Joint:
    name, kind = _text(element, "name"), _text(element, "type")
    wrong = f"joint '{name}' is of type '{kind}', which is not known"
    refuse_unknown(kind, _KINDS, wrong, element.where, "joint types")
    axis = _only(element, "axis")
    moves = kind in _SINGLE
    mimic, follows = None, _only(element, "mimic") if moves else None
    if follows is not None:
        ratio, offset = number_of(follows, "multiplier", 1.0), number_of(follows, "offset", 0.0)
        mimic = Mimic(_text(follows, "joint"), ratio, offset)
    return Joint(
        name,
        cast(MechanismJointKind, kind),
        _text(_needed(element, "parent"), "link"),
        _text(_needed(element, "child"), "link"),
        placement_of(element),
        frozen(numbers_of(axis, "xyz", 3) if axis is not None and moves else (1.0, 0.0, 0.0)),
        limits=_limits(element, kind) if moves else Limits(),
        mimic=mimic,
        where=element.where,
    )


def _limits(joint: Element, kind: str) -> Limits:
    limit = _only(joint, "limit")
    if limit is None:
        return Limits()
    lower, upper = -math.inf, math.inf
    if kind != "continuous" and {"lower", "upper"} & set(limit.attributes):
        lower, upper = (number_of(limit, end, 0.0, True) for end in ("lower", "upper"))
    velocity = number_of(limit, "velocity", 0.0, True) or math.inf
    return Limits(lower, upper, velocity, number_of(limit, "effort", math.inf, True))
