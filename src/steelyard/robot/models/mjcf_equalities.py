"""Equality constraints of a compiled MJCF: mimics, pins, and what only locked joints satisfy."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from steelyard.robot.inertia_and_placement import Placement
from steelyard.robot.mechanism import Coupling, Mimic, Pin
from steelyard.robot.models.mjcf_forces import (
    joints_of,
    joints_to,
    name_of,
    single_joints,
    wraps_of,
)

WORLD = "world"


def reference(model: Any, joint: int) -> float:
    """The reference position of a hinge or slide joint [rad; m]."""
    return float(model.qpos0[int(model.jnt_qposadr[joint])])


@dataclass(frozen=True)
class _Proportion:
    r"""$q - r = c_0 + c_1 (q_m - r_m)$ of a joint and its master, by their numbers."""

    joint: int
    master: int
    offset: float
    ratio: float


@dataclass(frozen=True)
class Equalities:
    """The active equality constraints of a file."""

    path: Path
    model: Any

    def mimics(self) -> dict[int, Mimic]:
        r"""Joints in proportion to another, $q_1 - r_1 = c_0 + c_1 (q_2 - r_2)$, $r$ references.

        A fixed tendon of two joints that keeps its length, $a_1 (q_1 - r_1) + a_2 (q_2 - r_2) = d$,
        is one as well: its second joint follows the first, or where that follows already, the first
        the second.
        """
        mimics = dict[int, Mimic]()
        for tie in self._proportions().values():
            own, other = reference(self.model, tie.joint), reference(self.model, tie.master)
            offset = tie.offset + own - tie.ratio * other
            mimics[tie.joint] = Mimic(self._joint(tie.master), tie.ratio, offset)
        return mimics

    def pins(self, origins: Mapping[int, Placement]) -> list[Pin]:
        """`connect` equalities between bodies or sites; `origins` are of bodies in their links."""
        model, pins = self.model, []
        for index in self._active(mujoco.mjtEq.mjEQ_CONNECT):
            ends = self._ends(index)
            points = np.reshape(model.eq_data[index][:6], (2, 3))
            if mujoco.mjtObj(int(model.eq_objtype[index])) == mujoco.mjtObj.mjOBJ_SITE:
                points = model.site_pos[[int(model.eq_obj1id[index]), int(model.eq_obj2id[index])]]
            placed = [
                origins[body].position + origins[body].rotation @ point
                for body, point in zip(ends, points, strict=True)
            ]
            links = (self._link(ends[0]), self._link(ends[1]))
            pins.append(Pin(self._name(index), links, np.array(placed), self._where(index)))
        return pins

    def couplings(self) -> tuple[list[Coupling], list[str]]:
        """All other equalities with the joints that they tie, and notes on those left out.

        A weld to a mocap body is a controller, and one at a free body holds that where it is: both
        are left out.
        """
        kinds, couplings, notes = mujoco.mjtEq, list[Coupling](), list[str]()
        proportional, single = self._proportions(), single_joints(self.model)
        for index in self._active():
            kind = kinds(int(self.model.eq_type[index]))
            if kind == kinds.mjEQ_CONNECT or index in proportional:
                continue
            if kind == kinds.mjEQ_WELD:
                ends = self._ends(index)
                joints = self._between(ends)
                what = "a weld"
                if any(self.model.body_mocapid[b] >= 0 or self._floats(b) for b in ends):
                    both = " and ".join(f"'{self._link(body)}'" for body in ends)
                    notes.append(f"the weld of {both} is left out")
                    continue
            elif kind == kinds.mjEQ_JOINT:
                numbers = (int(self.model.eq_obj1id[index]), int(self.model.eq_obj2id[index]))
                joints = [k for k in numbers if k >= 0]
                second = self._proportional(index)
                what = (
                    f"a joint equality that is {'one too many' if second else 'not proportional'}"
                )
            elif kind == kinds.mjEQ_TENDON:
                joints, what = self._of_tendons(index), "a tendon equality"
            else:
                flex, what = int(self.model.eq_obj1id[index]), "a flex equality"
                first = int(self.model.flex_vertadr[flex])
                last = first + int(self.model.flex_vertnum[flex])
                bodies = self.model.flex_vertbodyid[first:last]
                joints = self._between([int(body) for body in bodies])
            named = tuple(dict.fromkeys(self._joint(k) for k in joints if k in single))
            if named:
                couplings.append(Coupling(self._name(index), what, named, self._where(index)))
        return couplings, notes

    def offsets(self) -> dict[str, float]:
        """Joints that an equality holds off their reference while the other is at its own."""
        model = self.model
        found = {
            self._joint(int(model.eq_obj1id[index])): float(model.eq_data[index][0])
            for index in self._active(mujoco.mjtEq.mjEQ_JOINT)
        }
        return found | {self._joint(t.joint): t.offset for t in self._proportions().values()}

    def _active(self, kind: Any = None) -> list[int]:
        model = self.model
        wanted = range(model.neq) if kind is None else np.flatnonzero(model.eq_type == int(kind))
        return [int(k) for k in wanted if model.eq_active0[k]]

    def _proportions(self) -> dict[int, "_Proportion"]:
        """Equalities that are one joint following another in proportion, by their numbers."""
        model, found, masters = self.model, dict[int, _Proportion](), dict[int, int]()
        for index in self._active(mujoco.mjtEq.mjEQ_JOINT):
            joint, master = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
            if self._proportional(index) and joint not in masters:
                offset, ratio = (float(term) for term in model.eq_data[index][:2])
                found[index] = _Proportion(joint, master, offset, ratio)
                masters[joint] = master
        for index in self._active(mujoco.mjtEq.mjEQ_TENDON):
            if (pair := self._pair(index)) is None:
                continue
            (first, a), (second, b) = pair.items()
            if second in masters:
                first, a, second, b = second, b, first, a
            end = first
            while end != second and end in masters:
                end = masters[end]
            if second not in masters and end != second:
                offset = float(model.eq_data[index][0]) / b
                found[index] = _Proportion(second, first, offset, -a / b)
                masters[second] = first
        return found

    def _proportional(self, index: int) -> bool:
        return bool(self.model.eq_obj2id[index] >= 0 and not self.model.eq_data[index][2:5].any())

    def _pair(self, index: int) -> dict[int, float] | None:
        """The two joints of an equality's fixed tendon with their coefficients, if it is such."""
        wraps = wraps_of(self.model, int(self.model.eq_obj1id[index]))
        pair = {k: x for kind, k, x in wraps if kind == mujoco.mjtWrap.mjWRAP_JOINT and x}
        alone = self.model.eq_obj2id[index] < 0
        return pair if alone and len(wraps) == len(pair) == 2 else None

    def _name(self, index: int) -> str:
        return name_of(self.model, "eq", index)

    def _joint(self, index: int) -> str:
        return name_of(self.model, "joint", index)

    def _link(self, body: int) -> str:
        return name_of(self.model, "body", body) if body else WORLD

    def _where(self, index: int) -> str:
        return f"{self.path}, equality '{self._name(index)}'"

    def _ends(self, index: int) -> tuple[int, int]:
        first, second = int(self.model.eq_obj1id[index]), int(self.model.eq_obj2id[index])
        if mujoco.mjtObj(int(self.model.eq_objtype[index])) == mujoco.mjtObj.mjOBJ_SITE:
            return int(self.model.site_bodyid[first]), int(self.model.site_bodyid[second])
        return first, second

    def _floats(self, body: int) -> bool:
        kinds = [int(self.model.jnt_type[joint]) for joint in joints_of(self.model, body)]
        return kinds == [int(mujoco.mjtJoint.mjJNT_FREE)]

    def _between(self, bodies: Sequence[int]) -> list[int]:
        """Joints that move some of the bodies against the others."""
        lines = [joints_to(self.model, body) for body in bodies]
        moving = {joint for line in lines for joint in line}
        return sorted(k for k in moving if not all(k in line for line in lines))

    def _of_tendons(self, index: int) -> list[int]:
        """Joints that change the length of an equality's tendons."""
        model, joints = self.model, list[int]()
        for tendon in (int(model.eq_obj1id[index]), int(model.eq_obj2id[index])):
            wraps = wraps_of(model, tendon) if tendon >= 0 else []
            joints += [k for kind, k, _ in wraps if kind == mujoco.mjtWrap.mjWRAP_JOINT]
            sites = [k for kind, k, _ in wraps if kind == mujoco.mjtWrap.mjWRAP_SITE]
            joints += self._between([int(model.site_bodyid[k]) for k in sites])
        return joints
