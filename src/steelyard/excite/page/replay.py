"""A motion in the browser by viser, with its solids as triangles."""

from __future__ import annotations

import io
import socket
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, redirect_stdout
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import OutputError
from steelyard.excite.collision.solids import Ellipsoid, HalfSpace, Hull, Solid
from steelyard.excite.page.stage import Stage

if TYPE_CHECKING:
    import viser


Faces = NDArray[np.uint32]

ROUND_CORNERS = 32
"""Corners around a round solid."""

HALF_SPACE_EDGE = 3.0
"""Edge of the square that stands for a half-space [m]."""


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
    """The hull of points that are not all in a plane."""
    from scipy.spatial import ConvexHull

    found = ConvexHull(points)
    used, faces = np.unique(found.simplices, return_inverse=True)
    faces = faces.reshape(found.simplices.shape)
    corners = points[used]
    a, b, c = (corners[faces[:, k]] for k in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0.0
    faces[inwards] = faces[inwards][:, ::-1]
    return corners, faces.astype(np.uint32)


SPEEDS = (0.1, 2.0)
"""Range of the speed, over that of the motion."""

FRAME_SECONDS = 1.0 / 40.0
"""Time between two pictures [s]."""

LINK_COLOURS = ((208, 214, 222), (150, 165, 182))
"""Of links in turn."""

CELL, PATH = (196, 178, 148), (213, 94, 0)
ROOM, FORBIDDEN = (116, 136, 160), (168, 38, 29)


@dataclass
class Clock:
    """What time of the motion it is.

    Attributes:
        duration: Length of the motion [s].
        speed: Seconds of the motion a second.
        now: Time of the motion [s].
        running: Whether it goes on.
    """

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
    """A server that shows a stage.

    Attributes:
        stage: What is shown.
        clock: What time of the motion is shown.
        server: viser's server.
    """

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
        with _quiet():
            self.server.stop()


def replayed(stage: Stage, host: str, port: int, speed: float = 1.0) -> Replay:
    """Start a server that shows a stage.

    Args:
        stage: What is shown.
        host: Address that it listens at.
        port: Where; the next free one if it is taken.
        speed: Seconds of the motion a second.

    Raises:
        OutputError: viser is not installed, or nothing can listen there.
    """
    try:
        import viser
    except ImportError as error:
        raise OutputError(
            "the replay needs viser, which is not installed",
            where="steelyard replay",
            fix='pip install "steelyard[replay]"',
        ) from error
    _check_address(host)
    with _quiet():
        server = viser.ViserServer(host=host, port=port, label=stage.robot.name, verbose=False)
    replay = Replay(stage, Clock(stage.duration, speed), server)
    _scene(replay)
    _controls(replay)
    replay.show(0.0)
    return replay


def _check_address(host: str) -> None:
    """Refuse an address that is not one of this machine: viser would wait for it for ever.

    Raises:
        OutputError: Nothing can listen there.
    """
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


def _quiet() -> AbstractContextManager[object]:
    """Without what viser prints."""
    return redirect_stdout(io.StringIO())


def _scene(replay: Replay) -> None:
    """A grid at the base, links, cell, path and walls."""
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
    """Time, play and pause, speed, path."""
    gui, clock = replay.server.gui, replay.clock
    gui.configure_theme(show_logo=False, show_share_button=False)
    step = min(0.01, clock.duration)
    slider = gui.add_slider("Time [s]", 0.0, clock.duration, step, 0.0)
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
