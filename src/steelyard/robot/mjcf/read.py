"""MJCF files, compiled by MuJoCo."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import ModelError
from steelyard.robot.geometry import Placement, turn
from steelyard.robot.inertia import Inertia
from steelyard.robot.links import Joint, Link
from steelyard.robot.mechanism import Mechanism
from steelyard.robot.mjcf.assets import Compiled, compiled
from steelyard.robot.mjcf.efforts import Actuators
from steelyard.robot.mjcf.equalities import WORLD, Equalities, name_of, reference
from steelyard.robot.mjcf.passive_forces import passive_notes, springs_of
from steelyard.robot.robot import Limits
from steelyard.robot.ties import Mimic
from steelyard.robot.xml_reader import read_xml


def read_mjcf(path: Path) -> Mechanism:
    """The mechanism of an MJCF file.

    The world is the root link. A body with several joints becomes a chain with frames without
    mass between; a link's frame has the body's axes and its origin at the joint's anchor. Joint
    equalities of first order become mimics, `connect` becomes a pin, `ref` is kept (positions are
    MuJoCo's `qpos`). Limits of effort are those of the actuators. Armature, damping and friction
    are no part of the mechanism: they are identified. Springs are listed, and whatever else the
    mechanism is without (gravity that is switched off or compensated, tendons, fluids) is noted.

    Free and ball joints are kept as such, and equalities that are neither of these as couplings:
    a robot has neither. A body whose inertia is computed from a mesh that is absent has none.

    Raises:
        ModelError: MuJoCo cannot compile the file.
    """
    root = read_xml(path)
    if root.tag != "mujoco":
        raise ModelError(
            f"the file is not an MJCF: its outermost element is <{root.tag}>",
            where=root.where,
            fix="give an MJCF (<mujoco>), a URDF (<robot>) or a robot file (.toml)",
        )
    given = compiled(path)
    if given.model.nbody == 1 and root.all("body"):
        raise ModelError(
            "its bodies stand outside <worldbody>: a part of a model, not a robot",
            where=str(path),
            fix="give the file that includes it, often in the same folder",
        )
    name = root.attributes.get("model") or path.stem
    return _Reading(path, given, Actuators.of(given.model)).mechanism(name)


@dataclass(frozen=True)
class _Reading:
    """One pass over the bodies of a compiled model."""

    path: Path
    compiled: Compiled
    actuators: Actuators
    links: list[Link] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)

    @property
    def model(self) -> Any:
        """MuJoCo's model."""
        return self.compiled.model

    def mechanism(self, name: str) -> Mechanism:
        self.links.append(Link(WORLD, None, str(self.path)))
        equalities = Equalities(self.path, self.model)
        mimics = equalities.mimics()
        origins = {0: Placement()}
        for body in range(1, self.model.nbody):
            origins[body] = self._body(body, origins[int(self.model.body_parentid[body])], mimics)
        pins, (couplings, notes) = equalities.pins(origins), equalities.couplings()
        return Mechanism(
            name,
            self.links,
            self.joints,
            self.model.opt.gravity,
            str(self.path),
            pins=pins,
            driven=self._driven(),
            pulled=self._pulled(),
            rest=self._rest(equalities.offsets()) if pins or couplings else {},
            springs=springs_of(self.model, self._name),
            statements=[*self.actuators.notes(self._name), *passive_notes(self.model, self._name)],
            couplings=couplings,
            notes=notes,
        )

    def _rest(self, offsets: Mapping[str, float]) -> dict[str, float]:
        """Reference positions of the joints of one degree of freedom, where equalities hold."""
        numbers = {self._name("joint", k): k for k in range(self.model.njnt)}
        return {
            j.name: reference(self.model, numbers[j.name]) + offsets.get(j.name, 0.0)
            for j in self.joints
            if j.movable
        }

    def _pulled(self) -> list[str]:
        """Joints that the fixed tendons of actuators run over."""
        import mujoco

        model, joints = self.model, list[int]()
        for k in range(model.nactuator):
            if int(model.actuator_trntype[k]) != int(mujoco.mjtTrn.mjTRN_TENDON):
                continue
            tendon = int(model.actuator_trnid[k][0])
            first = int(model.tendon_adr[tendon])
            for wrap in range(first, first + int(model.tendon_num[tendon])):
                if int(model.wrap_type[wrap]) == int(mujoco.mjtWrap.mjWRAP_JOINT):
                    joints.append(int(model.wrap_objid[wrap]))
        return [self._name("joint", k) for k in dict.fromkeys(joints)]

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

    def _body(self, body: int, parent_origin: Placement, mimics: dict[int, Mimic]) -> Placement:
        """Adds the body and its joints; returns the body's frame in its link's frame."""
        model = self.model
        name, where = self._name("body", body), f"{self.path}, body '{self._name('body', body)}'"
        parent_body = int(model.body_parentid[body])
        parent = self._name("body", parent_body) if parent_body else WORLD
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
        lacks = self.compiled.without_inertia.get(body, "")
        inertia = None if lacks else self._inertia(body, origin)
        self.links.append(Link(name, inertia, where, lacks=lacks))
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
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            return Joint(name, "floating", parent, child, placement, where=where)
        if kind == mujoco.mjtJoint.mjJNT_BALL:
            return Joint(name, "ball", parent, child, placement, where=where)
        axis, ref = frozen(model.jnt_axis[joint]), reference(model, joint)
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

    def _name(self, kind: str, index: int) -> str:
        return name_of(self.model, kind, index)


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
