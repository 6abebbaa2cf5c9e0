"""MJCF files, compiled by MuJoCo."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import ModelError
from steelyard.robot.geometry import Placement, turn
from steelyard.robot.inertia import Inertia
from steelyard.robot.mechanism import Joint, Link, Mechanism, Mimic, Pin
from steelyard.robot.mjcf_efforts import Actuators
from steelyard.robot.mjcf_passive import passive_notes, springs_of
from steelyard.robot.robot import Limits
from steelyard.robot.xml_reader import read_xml

_WORLD = "world"


def read_mjcf(path: Path) -> Mechanism:
    """The mechanism of an MJCF file.

    The world is the root link. A body with several joints becomes a chain with frames without
    mass between; a link's frame has the body's axes and its origin at the joint's anchor. Joint
    equalities of first order become mimics, `connect` becomes a pin, `ref` is kept (positions are
    MuJoCo's `qpos`). Limits of effort are those of the actuators. Armature, damping and friction
    are no part of the mechanism: they are identified. Springs are listed, and whatever else the
    mechanism is without (gravity that is switched off or compensated, tendons, fluids) is noted.

    Raises:
        ModelError: MuJoCo cannot compile the file, or it holds ball or free joints or chains
            that are closed otherwise.
    """
    root = read_xml(path)
    if root.tag != "mujoco":
        raise ModelError(
            f"the file is not an MJCF: its outermost element is <{root.tag}>",
            where=root.where,
            mend="give an MJCF (<mujoco>), a URDF (<robot>) or a robot file (.toml)",
        )
    model = _compiled(path)
    name = root.attributes.get("model") or path.stem
    return _Reading(path, model, Actuators.of(model)).mechanism(name)


def _compiled(path: Path) -> Any:
    """MuJoCo's model of the file."""
    import mujoco

    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError) as error:
        text = " ".join(str(error).split())
        missing = "opening file" in text or "not found" in text or "resource" in text.lower()
        raise ModelError(
            f"MuJoCo cannot compile the file: {text}",
            where=str(path),
            mend="put the missing file where the MJCF looks for it (see its meshdir), or remove "
            "the geoms that use it and give their bodies an <inertial>"
            if missing
            else "mend the MJCF there until `python -m mujoco.viewer --mjcf=FILE` shows it",
        ) from None


@dataclass(frozen=True)
class _Reading:
    """One pass over the bodies of a compiled model."""

    path: Path
    model: Any
    actuators: Actuators
    links: list[Link] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)

    def mechanism(self, name: str) -> Mechanism:
        self.links.append(Link(_WORLD, None, str(self.path)))
        mimics = self._mimics()
        origins = {0: Placement()}
        for body in range(1, self.model.nbody):
            origins[body] = self._body(body, origins[int(self.model.body_parentid[body])], mimics)
        pins = self._pins(origins)
        return Mechanism(
            name,
            self.links,
            self.joints,
            self.model.opt.gravity,
            str(self.path),
            pins=pins,
            driven=self._driven(),
            rest={j.name: self._reference(k) for k, j in self._by_number()} if pins else {},
            springs=springs_of(self.model, self._name),
            statements=[*self.actuators.notes(self._name), *passive_notes(self.model, self._name)],
        )

    def _by_number(self) -> list[tuple[int, Joint]]:
        """MuJoCo's joints with their numbers."""
        named = {self._name("joint", k): k for k in range(self.model.njnt)}
        return [(named[j.name], j) for j in self.joints if j.name in named]

    def _driven(self) -> list[str]:
        """Joints with an actuator of their own."""
        import mujoco

        kinds = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
        model = self.model
        return [
            self._name("joint", int(model.actuator_trnid[k][0]))
            for k in range(model.nactuator)
            if mujoco.mjtTrn(int(model.actuator_trntype[k])) in kinds
        ]

    def _pins(self, origins: dict[int, Placement]) -> list[Pin]:
        """`connect` equalities between bodies or sites."""
        import mujoco

        model, pins = self.model, []
        for index in range(model.neq):
            kind = mujoco.mjtEq(int(model.eq_type[index]))
            if not model.eq_active0[index] or kind != mujoco.mjtEq.mjEQ_CONNECT:
                continue
            ends = [int(model.eq_obj1id[index]), int(model.eq_obj2id[index])]
            points = np.reshape(model.eq_data[index][:6], (2, 3))
            if mujoco.mjtObj(int(model.eq_objtype[index])) == mujoco.mjtObj.mjOBJ_SITE:
                points = model.site_pos[ends]
                ends = [int(model.site_bodyid[site]) for site in ends]
            name = self._name("eq", index)
            first, second = (_WORLD if body == 0 else self._name("body", body) for body in ends)
            placed = [
                origins[body].position + origins[body].rotation @ point
                for body, point in zip(ends, points, strict=True)
            ]
            where = f"{self.path}, equality '{name}'"
            pins.append(Pin(name, (first, second), np.array(placed), where))
        return pins

    def _body(self, body: int, parent_origin: Placement, mimics: dict[int, Mimic]) -> Placement:
        """Adds the body and its joints; returns the body's frame in its link's frame."""
        model = self.model
        name, where = self._name("body", body), f"{self.path}, body '{self._name('body', body)}'"
        parent_body = int(model.body_parentid[body])
        parent = self._name("body", parent_body) if parent_body else _WORLD
        start = parent_origin @ Placement(_rotation(model.body_quat[body]), model.body_pos[body])
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        if count == 0:
            self.joints.append(Joint(f"{name}_fixed", "fixed", parent, name, start, where=where))
            anchor = np.zeros(3)
        for joint in range(first, first + count):
            anchor = frozen(model.jnt_pos[joint])
            last = joint == first + count - 1
            child = name if last else f"{name}/{self._name('joint', joint)}"
            placement = start @ Placement(position=anchor)
            self.joints.append(self._joint(joint, parent, child, placement, mimics))
            if not last:
                self.links.append(Link(child, Inertia.zero(), where, massless=True))
            parent, start = child, Placement(position=-anchor)
        origin = Placement(position=-anchor)
        self.links.append(Link(name, self._inertia(body, origin), where))
        return origin

    def _inertia(self, body: int, origin: Placement) -> Inertia | None:
        model = self.model
        mass = float(model.body_mass[body])
        if mass == 0.0 and not np.any(model.body_inertia[body]):
            return None
        principal = Inertia.about_com(mass, (0.0, 0.0, 0.0), np.diag(model.body_inertia[body]))
        in_body = principal.moved(_rotation(model.body_iquat[body]), model.body_ipos[body])
        return in_body.moved(origin.rotation, origin.position)

    def _joint(
        self, joint: int, parent: str, child: str, placement: Placement, mimics: dict[int, Mimic]
    ) -> Joint:
        import mujoco

        model = self.model
        name, kind = self._name("joint", joint), mujoco.mjtJoint(int(model.jnt_type[joint]))
        where = f"{self.path}, joint '{name}'"
        if kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL):
            word = "free" if kind == mujoco.mjtJoint.mjJNT_FREE else "ball"
            raise ModelError(
                f"joint '{name}' is a {word} joint, which has more than one degree of freedom",
                where=where,
                mend="give the robot alone, on a fixed base, with hinge and slide joints",
            )
        axis, ref = frozen(model.jnt_axis[joint]), self._reference(joint)
        slide = kind == mujoco.mjtJoint.mjJNT_SLIDE
        at_zero = Placement(position=-ref * axis) if slide else Placement(turn(axis, -ref))
        limited = bool(model.jnt_limited[joint])
        lower, upper = model.jnt_range[joint] if limited else (-math.inf, math.inf)
        return Joint(
            name,
            "prismatic" if slide else "revolute" if limited else "continuous",
            parent,
            child,
            placement @ at_zero,
            axis,
            Limits(float(lower), float(upper), effort=float(self.actuators.limits[joint])),
            mimics.get(joint),
            where,
        )

    def _reference(self, joint: int) -> float:
        return float(self.model.qpos0[int(self.model.jnt_qposadr[joint])])

    def _name(self, kind: str, index: int) -> str:
        named = getattr(self.model, kind)(index).name
        return str(named) or f"{kind}_{index}"

    def _mimics(self) -> dict[int, Mimic]:
        r"""Joint equalities: $q_1 - r_1 = c_0 + c_1 (q_2 - r_2)$, with the references $r$."""
        import mujoco

        mimics: dict[int, Mimic] = {}
        for index in range(self.model.neq):
            kind = mujoco.mjtEq(int(self.model.eq_type[index]))
            if not self.model.eq_active0[index] or kind == mujoco.mjtEq.mjEQ_CONNECT:
                continue
            follower, master = int(self.model.eq_obj1id[index]), int(self.model.eq_obj2id[index])
            terms = self.model.eq_data[index][:5]
            if kind != mujoco.mjtEq.mjEQ_JOINT or master < 0 or np.any(terms[2:]):
                raise ModelError(
                    "an equality constraint is more than one joint following another in proportion",
                    where=f"{self.path}, equality '{self._name('eq', index)}'",
                    mend="make a pin of it (<connect>), or remove it from a copy of the MJCF and "
                    "lock its joints in a robot file",
                )
            offset = self._reference(follower) + float(terms[0])
            ratio = float(terms[1])
            offset -= ratio * self._reference(master)
            mimics[follower] = Mimic(self._name("joint", master), ratio, offset)
        return mimics


def _rotation(quaternion: Array) -> Array:
    """The rotation matrix of a unit quaternion `w, x, y, z`."""
    w, x, y, z = (float(v) for v in quaternion)
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )
