"""An identified model as a URDF or MJCF file: written, read again, and noted what it lacks."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import ModelError, OutputError
from steelyard.base.files import whole_file
from steelyard.check.fitted.implausible_estimates_and_gear_side import light_links
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.export.model_files.edited_urdf import urdf_behind, urdf_with
from steelyard.export.model_files.representable_content import (
    FORMAT_NAMES,
    Content,
    Format,
    base_of,
    content_of,
)
from steelyard.export.model_files.urdf_and_mjcf import document, head_of, mjcf_of, urdf_of
from steelyard.robot.file.model_reading_and_loaded_robot import read_mechanism
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES
from steelyard.robot.mechanism import Mechanism
from steelyard.robot.robot import FLOATING, Body, Robot
from steelyard.robot.robot_from_mechanism import reduced
from steelyard.uses.control.feedforward import refuse_unknown_gains

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
    refuse_unknown_gains(identified)
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
    base = FLOATING if wanted.floating else base
    names = [c.name for c in wanted.joints[wanted.n_base :]]
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
