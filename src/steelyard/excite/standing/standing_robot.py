r"""A robot that stands as a closed chain: its base moves freely, the legs follow, the feet stay.

Three sliding and three turning joints without mass carry the base from where it stands upright: the
world's x, y and z, then yaw, pitch and roll, $R = R_z R_y R_x$. Points of the feet are pinned to
the world, so that the base and the other limbs are independent, and the joints of the legs passive.
The tree is the same robot without pins: all its joints are independent.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError
from steelyard.excite.constraints.constraint_and_limits import Gap
from steelyard.excite.trajectories.motion_families import FAMILIES, by_joint
from steelyard.model.equations.frame_and_point_kinematics import frame_of
from steelyard.model.model import Model, model_with_open_friction, with_friction
from steelyard.model.terms.term import ActsOnAxes, Term
from steelyard.robot.file.excitation_sections import (
    ExcitationSection,
    StanceSection,
    WorkspaceSection,
)
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.loop_closures import loop_equations
from steelyard.robot.robot import (
    BASE_COORDINATES,
    Body,
    Coordinate,
    Frame,
    Limits,
    LoopClosure,
    Robot,
    bodies_along,
    frame_origins,
)

SMOOTHING = 0.02  # speed within which friction of the legs' joints turns [rad/s; m/s]

_WHERE = "[excitation.stance]"
_CHAIN = (0, 1, 2, 5, 4, 3)  # coordinates of the base from the world to its frame
_LEVEL = 5e-3  # difference of heights of feet that is told [m]
_FLAT = 1e-3  # extent of the feet's points across, below which they bear no moment [m]


def standing(loaded: LoadedRobot, section: StanceSection) -> tuple[LoadedRobot, Model, Gap]:
    """The robot with its feet pinned, its model, and what a motion on them does not show.

    Raises:
        ModelError: The base does not float, or the feet cannot hold it.
    """
    _refuse_unfit(loaded)
    robot, names = loaded.robot, loaded.robot.joint_names[6:]
    posture = np.zeros(len(names))
    if section.posture is not None:
        fix = "give one number per joint: " + ", ".join(names)
        posture = by_joint(section.posture, names, f"{_WHERE} posture", posture, fix)
    tree = _tree(robot, section)
    at = np.concatenate([np.zeros(6), posture])
    loops = tuple(
        LoopClosure(frame.name, (-1, frame.body), np.array([place, frame.position]))
        for frame, place in zip(
            points_of_feet(tree, section, at), places_of_feet(tree, section, at), strict=True
        )
    )
    if np.linalg.svd(_centred(loops), compute_uv=False)[1] < _FLAT:
        raise ModelError(
            "the feet touch the floor along one line: nothing keeps the robot from falling over it",
            where=f"{_WHERE} feet",
            fix="name more feet, or the corners of their soles: points = [[...], [...], ...]",
        )
    legs = {
        tree.bodies[k].coordinate
        for loop in loops
        for k in tree.carriers(loop.bodies[1])
        if tree.bodies[k].coordinate >= len(BASE_COORDINATES)
    }
    order = [k for k in range(tree.n) if k not in legs] + sorted(legs)
    found = _reordered(tree, order, len(tree.coordinates) - len(legs), loops, at)
    try:
        loop_equations(found)
    except ModelError as error:
        raise ModelError(
            f"the feet do not determine the joints of their legs: {error.wrong}",
            where=_WHERE,
            fix="give a posture in which no leg is straight; each leg needs as many joints as its "
            "foot holds directions: 3 for a point, 6 for a sole",
        ) from None
    plain = with_friction(model_with_open_friction(loaded), loaded)
    model = Model(found, tuple(_acting(term, names) for term in plain.terms))
    kept = replace(loaded, robot=found, excitation=_above_floor(loaded, loops, tree))
    return kept, model, Gap(_what_is_assumed(section, loops))


def _above_floor(
    loaded: LoadedRobot, loops: Sequence[LoopClosure], tree: Robot
) -> ExcitationSection:
    """The tables with the base as the tool, and the floor at the feet's lowest point, if not given.

    The floor holds for all links but those that stand.
    """
    space = loaded.excitation.workspace or WorkspaceSection()
    changed: dict[str, Any] = {"frame": space.frame or loaded.robot.bodies[0].name}
    if space.floor is None:
        feet = {loop.bodies[1] for loop in loops}
        standing_links = [frame.name for frame in tree.frames if frame.body in feet]
        changed["floor"] = min(float(loop.points[0][2]) for loop in loops)
        changed["without"] = tuple(dict.fromkeys([*space.without, *standing_links]))
    return loaded.excitation.model_copy(update={"workspace": space.model_copy(update=changed)})


def _what_is_assumed(section: StanceSection, loops: Sequence[LoopClosure]) -> str:
    rise = float(np.ptp([loop.points[0][2] for loop in loops]))
    uneven = f", whose heights differ by {1e3 * rise:.0f} mm in the posture given"
    return (
        f"{', '.join(section.feet)} are taken to stand at fixed points of a horizontal floor"
        f"{uneven if rise > _LEVEL else ''}: a mass at such a point is not shown, and what a "
        "controller does for balance, forces of the legs against each other and pushes are not in "
        "the plan"
    )


def tree_of(robot: Robot) -> Robot:
    """The robot without pins: all joints are independent, in the same order."""
    return robot.changed(coordinates=robot.joints, passive=(), loops=())


def points_of_feet(robot: Robot, section: StanceSection, joints: Array) -> list[Frame]:
    """Where the feet touch in a posture `(n_joints,)`: a frame on its body for each point.

    A ball that rolls turns about its lowest point at every time, which stays the same point of the
    foot up to the radius times the square of its turn.
    """
    turns, found = bodies_along(robot, joints[None])[0], list[Frame]()
    for name in section.feet:
        foot = frame_of(robot, name)
        below = turns[foot.body + 1][0].T @ [0.0, 0.0, -section.radius]
        for k, point in enumerate(section.points, start=1):
            place = foot.position + foot.rotation @ np.array(point) + below
            title = name if len(section.points) == 1 else f"{name}, point {k}"
            found.append(Frame(title, foot.body, foot.rotation, place))
    return found


def places_of_feet(robot: Robot, section: StanceSection, joints: Array) -> Array:
    """Where these points are in the world in that posture, `(p, 3)` [m]."""
    points = points_of_feet(robot, section, joints)
    return np.asarray(frame_origins(robot, points, joints[None])[0])


def _refuse_unfit(loaded: LoadedRobot) -> None:
    section, robot = loaded.excitation, loaded.robot
    if not robot.floating:
        raise ModelError(
            "feet are named, but the base of the robot is fixed",
            where=_WHERE,
            fix='write [robot] base = "floating"',
        )
    unfit = {
        "closed chains or coupled motors": robot.passive or robot.transmission is not None,
        "loads": section.loads,
        "limits of power": section.limits.power or section.limits.total_power,
        "limits of jerk": section.limits.jerk,
        f"motions of kind '{section.motion.kind}'": section.motion.kind not in FAMILIES,
        "weights of the joints by list": isinstance(section.criterion.weights, tuple),
    }
    if what := [name for name, given in unfit.items() if given]:
        raise ModelError(
            f"motions of a robot that stands are not designed with {what[0]}",
            where=_WHERE,
            fix="leave that out, or leave [excitation.stance] out and hang the robot by its base",
        )


def _tree(robot: Robot, section: StanceSection) -> Robot:
    """The floating robot behind six joints without mass, at the world's origin."""
    eye, zero = np.eye(3), np.zeros(3)
    trunk = robot.bodies[0]
    chain = [
        Body(
            f"base frame {number}",
            coordinate.name,
            coordinate.kind,
            number - 1,
            eye,
            zero,
            eye[k % 3],
            k,
            massless=True,
        )
        for number, k in enumerate(_CHAIN)
        for coordinate in (BASE_COORDINATES[k],)
    ]
    last = replace(chain[-1], name=trunk.name, inertia=trunk.inertia, known=trunk.known)
    shift = len(chain) - 1
    bodies = [
        *chain[:-1],
        replace(last, massless=False),
        *(replace(body, parent=body.parent + shift) for body in robot.bodies[1:]),
    ]
    frames = tuple(replace(frame, body=frame.body + shift) for frame in robot.frames)
    ends = [section.sway] * 3 + [section.tilt] * 3
    base = tuple(
        Coordinate(c.name, c.kind, Limits(-most, most))
        for c, most in zip(BASE_COORDINATES, ends, strict=True)
    )
    return robot.changed(
        bodies=tuple(bodies), coordinates=(*base, *robot.coordinates[6:]), frames=frames
    )


def _reordered(
    tree: Robot, order: Sequence[int], independent: int, loops: Sequence[LoopClosure], at: Array
) -> Robot:
    """The tree with pins, its coordinates in another order, the last ones passive."""
    place = {old: new for new, old in enumerate(order)}
    coordinates = tuple(tree.coordinates[k] for k in order)
    return tree.changed(
        bodies=tuple(replace(b, coordinate=place[b.coordinate]) for b in tree.bodies),
        coordinates=coordinates[:independent],
        passive=coordinates[independent:],
        loops=tuple(loops),
        assembly=at[list(order)],
    )


def _centred(loops: Sequence[LoopClosure]) -> Array:
    """The feet's points about their mean along the floor, `(p + 2, 2)` [m]."""
    points = np.array([loop.points[0][:2] for loop in loops])
    return np.vstack([points - points.mean(axis=0), np.zeros((2, 2))])


def _acting(term: Term, joints: tuple[str, ...]) -> Term:
    """A term on all joints but those of the base; friction that turns smoothly."""
    if not isinstance(term, ActsOnAxes):
        return term
    if term.joints is None and term.motors is None and term.along is None:
        term = replace(term, joints=joints)
    smooth = getattr(term, "smoothing", None) == 0.0 and not getattr(term, "threshold", 0.0)
    changed: dict[str, Any] = {"smoothing": SMOOTHING} if smooth else {}
    return replace(term, **changed)
