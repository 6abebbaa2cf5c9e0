"""What a model file is in itself: no robot, or a robot that has to be refused, and why."""

import re
from typing import Any

import mujoco
from proofs.support.model_files import ModelFile
from proofs.support.model_oracles import urdf_oracle
from proofs.support.mujoco_oracle import ABSENT, compiled

MOVES = ("revolute", "continuous", "prismatic")


def not_a_robot(file: ModelFile) -> str:
    """Why a file is no robot to be read; empty where it is one."""
    if file.root is None:
        return ""
    if file.family == "URDF":
        return _urdf_object(file.root)
    if file.family == "xacro":
        return _xacro_part(file)
    if file.family == "MJCF":
        return _mjcf_part(file)
    return ""


def _urdf_object(root: Any) -> str:
    if not root.findall("link"):
        return "URDF without links"
    kinds = {joint.get("type") for joint in root.findall("joint")}
    return "" if kinds - {"fixed"} else "object without joints that move"


def _xacro_part(file: ModelFile) -> str:
    """A file of macros and properties, or one that others include."""
    aside = ("macro", "property", "arg", "include")
    outside = [e for e in file.root if str(e.tag).rsplit("}", 1)[-1] not in aside]
    built = [e for e in outside if "xacro" in str(e.tag) or e.tag in ("link", "joint")]
    if not built:
        return "macros without a robot"
    links = {link.get("name") for link in file.root.findall("link")}
    hangs = any(p.get("link") not in links for p in file.root.findall("joint/parent"))
    part = file.included and (hangs or not file.root.get("name"))
    return "part of other files" if part else ""


def _mjcf_part(file: ModelFile) -> str:
    if file.root.tag == "mujocoinclude":
        return "part of other files"
    model, why = compiled(file.path)
    if model is None:
        part = file.included and "mesh needed" not in why
        return "part of other files" if part or not _builds(file.root) else ""
    kinds = {mujoco.mjtJoint(int(kind)) for kind in model.jnt_type}
    if not kinds:
        return "scene without joints"
    return "loose objects alone" if kinds == {mujoco.mjtJoint.mjJNT_FREE} else ""


def _builds(root: Any) -> bool:
    return any(element.tag in ("body", "include") for element in root.iter())


def right_to_refuse(file: ModelFile, message: str) -> str:
    """What in the file makes it right to refuse it; empty where it could be read."""
    if file.family in ("URDF", "MJCF") and file.root is None:
        return "broken XML: nobody reads it"
    if file.family == "URDF":
        return _urdf_reason(file.root)
    if file.family == "MJCF":
        return _mjcf_reason(file)
    if file.family == "xacro":
        return _xacro_reason(file, message)
    return ""


def _urdf_reason(root: Any) -> str:
    kinds = {joint.get("type") for joint in root.findall("joint")}
    if not kinds & set(MOVES):
        return "no hinge or slide: nothing to identify"
    children = {
        j.find("child").get("link") for j in root.findall("joint") if j.find("child") is not None
    }
    if len([link for link in root.findall("link") if link.get("name") not in children]) > 1:
        return "several links without a parent: nothing says where they stand"
    if any(len(part.findall(tag)) > 1 for part in root for tag in ("axis", "limit", "inertial")):
        return "two elements where one counts"
    if any(_reversed(limit) for limit in root.findall("joint/limit")):
        return "lower limit above the upper one"
    names = {joint.get("name") for joint in root.findall("joint")}
    if any(mimic.get("joint") not in names for mimic in root.findall("joint/mimic")):
        return "follower of a joint that is not there"
    try:
        urdf_oracle(root, cleaned=False)
    except Exception:
        return "Pinocchio cannot build it either"
    if kinds & {"floating", "planar"}:
        return "joint with more than one degree of freedom: nothing states what is fixed"
    return ""


def _reversed(limit: Any) -> bool:
    return float(limit.get("lower", 0.0)) > float(limit.get("upper", 0.0))


def _mjcf_reason(file: ModelFile) -> str:
    model, why = compiled(file.path)
    if model is None:
        if "mesh needed" in why:
            return "absent mesh that a mass comes from"
        if re.search(ABSENT, why):
            return "absent file that it includes"
        return "MuJoCo cannot compile it either"
    kinds = [mujoco.mjtJoint(int(kind)) for kind in model.jnt_type]
    free, ball = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL
    trees: dict[int, set[Any]] = {}
    for number, kind in enumerate(kinds):
        trees.setdefault(int(model.body_rootid[model.jnt_bodyid[number]]), set()).add(kind)
    moving = [tree for tree in trees.values() if tree - {free, ball}]
    if not moving:
        return "no hinge or slide: nothing to identify"
    if any(not tree & {free, ball} for tree in moving):
        return ""
    if any(ball not in tree for tree in moving):
        return "floating base: nothing states what is fixed"
    return "ball joint: three degrees of freedom"


XACRO = {
    r"to be included does not exist": "absent file that it includes",
    r"the parent link '.*' of joint '.*' does not exist": "hangs on a link that it does not have",
    r"'.*' is not defined": "property that nothing defines",
}
"""The message on a xacro file that stands for no robot by itself, and what is wrong with it."""


def _xacro_reason(file: ModelFile, message: str) -> str:
    """What a xacro file lacks; the packages it names have to be in the folders above it."""
    for pattern, reason in XACRO.items():
        if re.search(pattern, message):
            return reason
    for package in set(re.findall(r"\$\(find ([\w-]+)\)", file.path.read_text(errors="replace"))):
        if not any((up / package).is_dir() or up.name == package for up in file.path.parents):
            return "package that it includes is not there"
    return ""
