"""A replay in the browser by viser: shapes of a robot along a motion, path of its tool."""

from __future__ import annotations

import io
import socket
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError, OutputError, require
from steelyard.excite.collision.robot_and_cell_shapes_from_files import robot_shapes
from steelyard.excite.collision.solids_and_shapes import (
    Ball,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Hull,
    Shape,
    ShapeKinematics,
    Solid,
    axes_along,
)
from steelyard.excite.collision.workspace_from_tables import tool_of, world_of
from steelyard.excite.page.tool_path_and_walls import all_lines, faces_of, tool_path
from steelyard.model.equations.passive_joints import passive_positions
from steelyard.robot.loop_closures import closest
from steelyard.robot.robot import Robot

if TYPE_CHECKING:
    import viser

    from steelyard.excite.constraints.tool_workspace import Marker
    from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
    from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot

PATH_POINTS_A_SECOND = 50.0  # points of the tool's path a second
MOST_PATH_POINTS = 6000  # most points of the path
STICK_RADIUS_SHARE = 0.02  # radius of a stick, over the length of the arm
SHORT_STICK = 1e-6  # sticks that are shorter [m] are left out


@dataclass(frozen=True, eq=False)
class Stage:
    """Everything that a replay shows; a stick stands for a link without shapes.

    At times of the path `(F,)` [s] positions of all joints and of the tool, `(F, 3)` [m]. Lines of
    walls, `(L, 2, 3)` each [m], and whether they are of boxes that are kept out of.
    """

    robot: Robot
    trajectory: ExactTrajectory
    shapes: tuple[Shape, ...]
    tool: Marker
    t: Array
    joints: Array
    path: Array
    walls: tuple[tuple[bool, Array], ...]
    notes: tuple[str, ...]

    @cached_property
    def _kinematics(self) -> ShapeKinematics:
        return ShapeKinematics(self.robot, self.shapes)

    def at(self, time: float) -> tuple[Array, Array]:
        """Axes `(G, 3, 3)` and origins `(G, 3)` [m] of all shapes at a time of the motion."""
        poses = self._kinematics(self._posture(time)[None])
        return poses.rotations[0], poses.origins[0]

    def _posture(self, time: float) -> Array:
        """Positions of all joints, shape `(n_joints,)`."""
        own = self.trajectory.derivative([time], 0)[0]
        if not self.robot.passive:
            return np.asarray(own)
        near = self.joints[np.argmin(np.abs(self.t - time))]
        n = self.robot.n
        return closest(self.robot, np.concatenate([own, near[n:]]), range(n, self.robot.n_joints))


def staged(loaded: LoadedRobot, trajectory: ExactTrajectory) -> Stage:
    """The stage of a robot and a motion of its joints.

    Raises:
        ModelError: The file of the cell cannot be read, or the tool is not there.
    """
    robot, section = loaded.robot, loaded.excitation
    tool = tool_of(section.workspace, robot)
    count = int(np.clip(PATH_POINTS_A_SECOND * trajectory.duration, 2, MOST_PATH_POINTS))
    t = np.linspace(0.0, trajectory.duration, count)
    q = trajectory.derivative(t, 0)
    joints = np.hstack([q, passive_positions(robot, q.T).T])
    path = tool_path(robot, tool, joints)
    links, notes = shapes_of(loaded)
    shapes = (*links, *sticks(robot, tool, {link.body for link in links}), *world_of(loaded))
    faces = faces_of(section.workspace, robot, path)
    kinds = {bad: [face for face in faces if face.forbidden == bad] for bad in (False, True)}
    walls = tuple((bad, all_lines(own)) for bad, own in kinds.items() if own)
    return Stage(robot, trajectory, shapes, tool, t, joints, path, walls, notes)


def shapes_of(loaded: LoadedRobot) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """Shapes of the links that have some, and why there are none."""
    section, model = loaded.excitation.collision, loaded.sources[-1].path
    skip = () if section is None else section.without
    if model.suffix == ".toml":
        return (), ("the robot has no model file: its links are drawn as sticks",)
    try:
        found = robot_shapes(loaded.robot, model, skip)
    except ModelError as error:
        return (), (f"links are drawn as sticks: {error.wrong}",)
    return found.shapes, ()


def sticks(robot: Robot, tool: Marker, shaped: set[int]) -> tuple[Shape, ...]:
    """Bodies without shapes: a ball at each joint, a stick to every joint and tool they carry.

    Those that have shapes are `shaped`; -1 is the base.
    """
    last = tool.on(robot)
    ends = [(body.parent, body.joint, body.position) for body in robot.bodies]
    ends.append((last.body, last.name, last.position))
    reach = sum(float(np.linalg.norm(end)) for _, _, end in ends)
    radius = max(STICK_RADIUS_SHARE * reach, 1e-3)
    found = []
    for k, body in enumerate(robot.bodies):
        if k not in shaped:
            found.append(Shape(body.name, k, np.eye(3), np.zeros(3), Ball(1.3 * radius)))
    for carrier, name, end in ends:
        length = float(np.linalg.norm(end))
        if carrier not in shaped and length > SHORT_STICK:
            turned = axes_along(end)
            found.append(Shape(f"to {name}", carrier, turned, 0.5 * end, Cylinder(radius, length)))
    return tuple(found)


Faces = NDArray[np.uint32]

ROUND_CORNERS = 32  # corners around a round solid
HALF_SPACE_EDGE = 3.0  # edge of the square that stands for a half-space [m]


def mesh_of(solid: Solid) -> tuple[Array, Faces]:
    """Corners `(V, 3)` [m] and triangles `(F, 3)`, counted so that their normals point outwards.

    A round solid becomes the hull of its farthest points in many directions.
    """
    if isinstance(solid, HalfSpace):
        x = 0.5 * HALF_SPACE_EDGE
        square = np.array([[-x, -x, 0.0], [x, -x, 0.0], [x, x, 0.0], [-x, x, 0.0]])
        return square, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
    if isinstance(solid, Hull):
        points = solid.vertices
    elif isinstance(solid, Ellipsoid):
        points = np.array(solid.semi) * _directions()
    else:
        points = solid.farthest(_directions())
    return _hull_mesh(np.unique(np.round(points, 9), axis=0))


def _directions() -> Array:
    """Unit vectors on circles of latitude, poles included, shape `(N, 3)`."""
    turn = 2.0 * np.pi * (np.arange(ROUND_CORNERS) + 0.5) / ROUND_CORNERS
    rise = np.linspace(-0.5 * np.pi, 0.5 * np.pi, ROUND_CORNERS // 2)
    up, around = (x.ravel() for x in np.meshgrid(rise, turn))
    across = np.cos(up)
    return np.column_stack([across * np.cos(around), across * np.sin(around), np.sin(up)])


def _hull_mesh(points: Array) -> tuple[Array, Faces]:
    from scipy.spatial import ConvexHull

    found = ConvexHull(points)
    used, faces = np.unique(found.simplices, return_inverse=True)
    faces = faces.reshape(found.simplices.shape)
    corners = points[used]
    a, b, c = (corners[faces[:, k]] for k in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0.0
    faces[inwards] = faces[inwards][:, ::-1]
    return corners, faces.astype(np.uint32)


SPEEDS = (0.1, 2.0)  # range of the speed, over that of the motion
FRAME_SECONDS = 1.0 / 40.0  # time between two pictures [s]
LINK_COLOURS = ((208, 214, 222), (150, 165, 182))  # of links in turn

CELL, PATH = (196, 178, 148), (213, 94, 0)
ROOM, FORBIDDEN = (116, 136, 160), (168, 38, 29)


@dataclass
class Clock:
    """What time of the motion it is [s], at `speed` seconds of the motion a second."""

    duration: float
    speed: float = 1.0
    now: float = 0.0
    running: bool = True

    def advance(self, seconds: float) -> None:
        """Let time pass; after the end it begins anew."""
        if self.running and self.duration > 0.0:
            self.now = (self.now + self.speed * seconds) % self.duration


@dataclass(eq=False)
class Replay:
    """A server that shows a stage."""

    stage: Stage
    clock: Clock
    server: viser.ViserServer
    _things: list[viser.MeshHandle] = field(default_factory=list)
    _slider: Any = None

    @property
    def address(self) -> str:
        """For a browser."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def show(self, now: float) -> None:
        """Move everything to where it is at a time of the motion [s]."""
        from viser.transforms import SO3

        rotations, origins = self.stage.at(now)
        with self.server.atomic():
            for thing, rotation, origin in zip(self._things, rotations, origins, strict=True):
                thing.wxyz, thing.position = SO3.from_matrix(rotation).wxyz, origin
        self.server.flush()

    def run(self, ended: Callable[[], bool]) -> None:
        """Play until `ended` says so."""
        before = time.monotonic()
        shown = None
        while not ended():
            time.sleep(FRAME_SECONDS)
            now = time.monotonic()
            self.clock.advance(now - before)
            before = now
            if self.clock.now != shown:
                shown = self.clock.now
                self.show(shown)
                if self.clock.running:
                    self._slider.value = round(shown, 3)

    def stop(self) -> None:
        """End the server."""
        with redirect_stdout(io.StringIO()):
            self.server.stop()


def replayed(stage: Stage, host: str, port: int, speed: float = 1.0) -> Replay:
    """Start a server at an address that shows a stage at a `speed`, at the next free port."""
    require("viser", "replay", "replays", "steelyard replay")
    import viser

    _check_address(host)
    with redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=host, port=port, label=stage.robot.name, verbose=False)
    replay = Replay(stage, Clock(stage.trajectory.duration, speed), server)
    _scene(replay)
    _controls(replay)
    replay.show(0.0)
    return replay


def _check_address(host: str) -> None:
    """Refuse an address that is not one of this machine: viser would wait for it for ever."""
    try:
        family = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as trial:
            trial.bind((host, 0))
    except OSError as error:
        raise OutputError(
            f"this machine has no address '{host}' to listen at: {error.strerror}",
            where="--host",
            fix="leave --host out for this machine alone, or give 0.0.0.0 for all others too",
        ) from error


def _scene(replay: Replay) -> None:
    stage, scene = replay.stage, replay.server.scene
    scene.set_up_direction("+z")
    drawn = np.concatenate([stage.path, np.zeros((1, 3))])
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    wide = max(2.0, 2.5 * float(np.abs(drawn).max()))
    scene.add_grid("/grid", width=wide, height=wide, cell_size=0.1, section_size=0.5)
    scene.add_frame("/base", axes_length=0.15, axes_radius=0.006)
    links = list(dict.fromkeys(shape.body for shape in stage.shapes))
    for number, shape in enumerate(stage.shapes):
        corners, faces = mesh_of(shape.solid)
        colour = CELL if shape.origin == "world" else LINK_COLOURS[links.index(shape.body) % 2]
        where = "cell" if shape.origin == "world" else "robot"
        name = f"/{where}/{shape.name.replace('/', '_')} {number}"
        replay._things.append(
            scene.add_mesh_simple(name, corners, faces, color=colour, side="double")
        )
    pieces = np.stack([stage.path[:-1], stage.path[1:]], axis=1)
    scene.add_line_segments("/path of the tool", pieces, PATH, thickness=0.004)
    for number, (bad, lines) in enumerate(stage.walls):
        colour = FORBIDDEN if bad else ROOM
        scene.add_line_segments(f"/wall {number}", lines, colour, thickness=0.002)
    middle = 0.5 * (low + high)
    away = max(0.9, 0.9 * float(np.linalg.norm(high - low)))
    replay.server.initial_camera.position = middle + away * np.array([0.75, -0.75, 0.45])
    replay.server.initial_camera.look_at = middle


def _controls(replay: Replay) -> None:
    gui, clock = replay.server.gui, replay.clock
    gui.configure_theme(show_logo=False, show_share_button=False)
    slider = gui.add_slider("Time [s]", 0.0, clock.duration, min(0.01, clock.duration), 0.0)
    button = gui.add_button("Pause")
    least, most = min(SPEEDS[0], clock.speed), max(SPEEDS[1], clock.speed)
    speed = gui.add_slider("Speed", least, most, 0.05, clock.speed)
    path = gui.add_checkbox("Path of the tool", True)
    for note in replay.stage.notes:
        gui.add_markdown(note)
    replay._slider = slider

    @slider.on_update
    def _(event: Any) -> None:
        if event.client is not None:
            clock.now, clock.running = float(slider.value), False
            button.label = "Play"

    @button.on_click
    def _(event: Any) -> None:
        clock.running = not clock.running
        button.label = "Pause" if clock.running else "Play"

    @speed.on_update
    def _(event: Any) -> None:
        clock.speed = float(speed.value)

    @path.on_update
    def _(event: Any) -> None:
        line = replay.server.scene.get_handle_by_name("/path of the tool")
        if line is not None:
            line.visible = path.value
