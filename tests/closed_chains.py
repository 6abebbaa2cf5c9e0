"""Invented closed chains, and MuJoCo with `connect` constraints as their oracle."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from invented import ball
from steelyard.base.arrays import Array
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.loop_closures import loop_equations
from steelyard.robot.robot import Body, Coordinate, Limits, LoopClosure, Robot

Z = (0.0, 0.0, 1.0)
EYE = np.eye(3)


def bar(name: str, parent: int, at: tuple[float, ...], coordinate: int, **fields: object) -> Body:
    """A bar on a hinge along z, by default with an awkward inertia."""
    known = {
        "kind": "revolute",
        "rotation": EYE,
        "axis": Z,
        "inertia": ball(len(name) + 7 * coordinate),
        "known": True,
        **fields,
    }
    return Body(
        name=name, joint=f"{name}_joint", parent=parent, position=at, coordinate=coordinate, **known
    )  # type: ignore[arg-type]


def hinges(*names: str, kind: str = "revolute", reach: float = 0.5) -> tuple[Coordinate, ...]:
    """Coordinates of bars."""
    limits = Limits(-reach, reach, 3.0, 100.0)
    return tuple(Coordinate(f"{n}_joint", kind, limits) for n in names)  # type: ignore[arg-type]


def five_bar() -> Robot:
    """Unequal bars in a vertical plane: two motors at the base, the elbows follow."""
    bodies = (
        bar("left", -1, (0.0, 0.0, 0.0), 0),
        bar("left_fore", 0, (0.3, 0.0, 0.0), 2),
        bar("right", -1, (0.25, 0.05, 0.0), 1),
        bar("right_fore", 2, (0.28, 0.0, 0.0), 3),
    )
    loop = LoopClosure("tip", (1, 3), [[0.4, 0.0, 0.0], [0.45, 0.02, 0.0]])
    return Robot(
        "five-bar",
        bodies,
        hinges("left", "right"),
        (1.0, -9.7, 0.0),
        passive=hinges("left_fore", "right_fore"),
        loops=(loop,),
        assembly=(2.4, 0.6, -1.2, 1.2),
    )


def parallelogram(inertias: tuple[Inertia, ...], l1: float, l2: float) -> Robot:
    """The five-bar of two parallelogram sides, base joints on one axis, in the horizontal plane."""
    one, two, three, four = inertias
    bodies = (
        bar("link1", -1, (0.0, 0.0, 0.0), 0, inertia=one),
        bar("link2", -1, (0.0, 0.0, 0.0), 1, inertia=two),
        bar("link3", 1, (l2, 0.0, 0.0), 2, inertia=three),
        bar("link4", 0, (l1, 0.0, 0.0), 3, inertia=four),
    )
    return Robot(
        "parallelogram",
        bodies,
        hinges("link1", "link2", reach=1.0),
        passive=hinges("link3", "link4"),
        loops=(LoopClosure("tip", (2, 3), [[l1, 0.0, 0.0], [l2, 0.0, 0.0]]),),
        assembly=(0.0, 1.5, -1.5, 1.5),
    )


def palletizer() -> Robot:
    """A loop on a turning column, its plane askew, with a follower inside and a hand beyond."""
    skew = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    bodies = (
        bar("column", -1, (0.0, 0.0, 0.4), 0, axis=(1.0, 0.0, 0.0)),
        bar("crank", 0, (0.1, 0.0, 0.2), 1, rotation=skew),
        bar("rod", 1, (0.2, 0.0, 0.0), 3),
        bar("arm", 0, tuple(np.array([0.1, 0.0, 0.2]) + skew @ [0.5, 0.0, 0.0]), 4, rotation=skew),
        bar("hand", 3, (0.1, 0.5, 0.0), 2, axis=(0.0, 1.0, 0.0)),
        bar("level", 3, (0.1, 0.1, 0.0), 4, ratio=-1.0, offset=0.3),
    )
    return Robot(
        "palletizer",
        bodies,
        hinges("column", "crank", "hand"),
        passive=hinges("rod", "arm"),
        loops=(LoopClosure("coupler", (2, 3), [[0.5, 0.0, 0.0], [0.0, 0.3, 0.0]]),),
        assembly=(0.0, 1.2, 0.0, -1.0, -0.2),
    )


def slider_crank() -> Robot:
    """A crank that pushes a slider, the pin offset, its guide fixed to the base."""
    guide = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    bodies = (
        bar("crank", -1, (0.0, 0.0, 0.0), 0),
        bar("rod", 0, (0.1, 0.0, 0.0), 1, ratio=-2.0, offset=0.4),
        bar(
            "piston",
            -1,
            (0.3, 0.1, 0.0),
            2,
            kind="prismatic",
            axis=(0.0, -1.0, 0.0),
            rotation=guide,
        ),
    )
    return Robot(
        "slider-crank",
        bodies,
        hinges("crank"),
        (0.0, -9.81, 0.0),
        passive=(*hinges("rod"), *hinges("piston", kind="prismatic")),
        loops=(LoopClosure("wrist pin", (1, 2), [[0.35, 0.0, 0.0], [0.0, 0.02, 0.0]]),),
        assembly=(1.0, 0.6, 0.1),
    )


def twin_loops() -> Robot:
    """A six-bar mechanism whose second loop stands on the passive joints of the first."""
    bodies = (
        bar("crank", -1, (0.0, 0.0, 0.0), 0),
        bar("coupler", 0, (0.2, 0.0, 0.0), 1),
        bar("rocker", -1, (0.5, 0.0, 0.0), 2),
        bar("dyad", 2, (0.15, 0.25, 0.0), 3),
        bar("lever", -1, (0.9, 0.1, 0.0), 4),
    )
    loops = (
        LoopClosure("first", (1, 2), [[0.5, 0.0, 0.0], [0.0, 0.4, 0.0]]),
        LoopClosure("second", (3, 4), [[0.45, 0.0, 0.0], [0.0, 0.3, 0.0]]),
    )
    return Robot(
        "six-bar",
        bodies,
        hinges("crank"),
        (0.0, -9.81, 0.0),
        passive=hinges("coupler", "rocker", "dyad", "lever"),
        loops=loops,
        assembly=(1.0, -0.6, 0.0, 0.0, 0.0),
    )


def spatial() -> Robot:
    """A loop in space, closed by a ball: three equations, three passive joints with skew axes."""
    bodies = (
        bar("left", -1, (0.0, 0.0, 0.0), 0, axis=(0.0, 0.6, 0.8)),
        bar("yaw", 0, (0.3, 0.1, 0.0), 2),
        bar("pitch", 1, (0.05, 0.0, 0.0), 3, axis=(0.0, 1.0, 0.0)),
        bar("right", -1, (0.6, 0.0, 0.1), 1, axis=(1.0, 0.0, 0.0)),
        bar("swing", 3, (0.0, 0.3, 0.0), 4, axis=(0.0, 0.0, 1.0)),
    )
    return Robot(
        "spatial",
        bodies,
        hinges("left", "right", reach=0.3),
        passive=hinges("yaw", "pitch", "swing"),
        loops=(LoopClosure("ball", (2, 4), [[0.4, 0.0, 0.0], [0.05, 0.25, 0.1]]),),
    )


CHAINS: dict[str, Callable[[], Robot]] = {
    "five-bar": five_bar,
    "palletizer": palletizer,
    "slider-crank": slider_crank,
    "six-bar": twin_loops,
    "spatial": spatial,
}


class Oracle:
    """MuJoCo's tree of the bodies, every pin a `connect` constraint."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        spec = mujoco.MjSpec()
        spec.option.gravity = robot.gravity
        spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        placed = [spec.worldbody]
        for index, body in enumerate(robot.bodies):
            placed.append(_add(placed[body.parent + 1], index, body))
        for loop in robot.loops:
            sites = [
                placed[body + 1].add_site(name=f"{loop.name} {end}", pos=point)
                for end, (body, point) in enumerate(zip(loop.bodies, loop.points, strict=True))
            ]
            pin = spec.add_equality(
                type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE
            )
            pin.name1, pin.name2 = (site.name for site in sites)
        self.model = spec.compile()
        self.free = self.model.__copy__()
        self.free.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.data = mujoco.MjData(self.model)
        order = [int(self.model.joint(k).name.split()[0]) for k in range(self.model.njnt)]
        self.map = np.zeros((len(order), robot.n_joints))
        for row, index in enumerate(order):
            self.map[row, robot.bodies[index].coordinate] = robot.bodies[index].ratio
        self.offset = np.array([robot.bodies[index].offset for index in order])

    def gap(self, q: Array) -> float:
        """Largest violation of a pin [m], all joints of shape `(n_joints,)`."""
        self._constraints(q)
        return float(np.abs(self.data.efc_pos).max())

    def basis(self, q: Array) -> Array:
        """Speeds of all joints per speed of the independent ones, `(n_joints, n)`, at all joints.

        MuJoCo's data are at these positions afterwards.
        """
        n, slope = self.robot.n, self._constraints(q)
        return np.vstack([np.eye(n), -np.linalg.pinv(slope[:, n:]) @ slope[:, :n]])

    def torque(self, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array, Array]:
        """Efforts, and velocity and acceleration of all joints, from MuJoCo's own constraints.

        Args:
            q: All joints, shape `(n_joints,)`.
            dq: Independent joints, shape `(n,)`; likewise `ddq`.
        """
        n, data = self.robot.n, self.data
        slope = self._constraints(q)
        basis = self.basis(q)
        all_dq = basis @ dq
        data.qvel[:] = self.map @ all_dq
        step = 1e-6
        ahead, back = (self._constraints(q + s * all_dq) @ all_dq for s in (step, -step))
        drift = (ahead - back) / (2.0 * step)
        all_ddq = basis @ ddq
        all_ddq[n:] -= np.linalg.pinv(slope[:, n:]) @ drift
        data.qpos[:], data.qvel[:] = self.map @ q + self.offset, self.map @ all_dq
        data.qacc[:] = self.map @ all_ddq
        mujoco.mj_inverse(self.free, data)
        return basis.T @ self.map.T @ data.qfrc_inverse, all_dq, all_ddq

    def _constraints(self, q: Array) -> Array:
        """MuJoCo's constraint Jacobian by our joints, `(rows, n_joints)`."""
        self.data.qpos[:] = self.map @ q + self.offset
        mujoco.mj_forward(self.model, self.data)
        return np.asarray(self.data.efc_J.reshape(-1, self.model.nv)[: self.data.nefc] @ self.map)


def _add(parent: Any, index: int, body: Body) -> Any:
    kinds = {"revolute": mujoco.mjtJoint.mjJNT_HINGE, "prismatic": mujoco.mjtJoint.mjJNT_SLIDE}
    added = parent.add_body(name=f"{index} {body.name}", pos=body.position)
    mujoco.mju_mat2Quat(added.quat, np.ascontiguousarray(body.rotation).ravel())
    about = body.inertia.inertia_com
    added.explicitinertial, added.mass, added.ipos = True, body.inertia.mass, body.inertia.com
    added.fullinertia = [about[k] for k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    added.add_joint(name=f"{index} {body.joint}", type=kinds[body.kind], axis=body.axis)
    return added


def independent_path(robot: Robot, n_samples: int, reach: float, seed: int = 0) -> Array:
    """A smooth way of the independent joints from the assembly, shape `(n, N)`."""
    rng = np.random.default_rng(seed)
    phase, speed = rng.uniform(0.0, 6.0, (robot.n, 1)), rng.uniform(0.5, 1.5, (robot.n, 1))
    t = np.linspace(0.0, 8.0, n_samples)
    start = loop_equations(robot).assembly[: robot.n, None]
    return np.asarray(start + reach * (np.sin(speed * t + phase) - np.sin(phase)))
