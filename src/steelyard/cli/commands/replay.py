"""`steelyard replay`: a robot along a motion, in three dimensions, in the browser."""

from pathlib import Path
from typing import Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import RobotArgument

HERE = "127.0.0.1"
"""This machine alone."""


@guarded
def replay(
    robot: RobotArgument,
    trajectory: Annotated[
        Path,
        typer.Argument(
            help="Motion: trajectory.json, or a table of time and positions.", metavar="TRAJECTORY"
        ),
    ],
    port: Annotated[
        int, typer.Option(min=1, max=65535, help="Port of the page in the browser.")
    ] = 8080,
    host: Annotated[
        str, typer.Option(help="Address to listen at; 0.0.0.0 accepts other machines.")
    ] = HERE,
    speed: Annotated[
        float, typer.Option(min=0.01, max=100.0, help="Playback speed, relative to the motion's.")
    ] = 1.0,
) -> None:
    r"""Animate a motion of a robot in the browser, until Ctrl-C.

    Links are drawn as their collision shapes, or as lines without one. Needs viser:
    pip install "steelyard\[replay]".

    Example: steelyard replay panda.toml panda-motion/trajectory.json
    """
    from steelyard.cli import interrupt
    from steelyard.excitation.trajectories.files import read_motion
    from steelyard.report.replay.replay import replayed
    from steelyard.report.replay.stage import staged
    from steelyard.robot_file.file import load_robot

    loaded = load_robot(robot)
    stage = staged(loaded, read_motion(trajectory, loaded.robot))
    for note in stage.notes:
        typer.echo(f"note        {note}")
    with interrupt.quietly():
        shown = replayed(stage, host, port, speed)
        typer.echo(f"replay      {shown.address}  (Ctrl-C ends it)")
        try:
            shown.run(interrupt.stop_requested)
        finally:
            shown.stop()
    interrupt.answered()
