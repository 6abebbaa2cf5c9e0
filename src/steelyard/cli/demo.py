"""`steelyard demo`: an arm of our own; its motion designed, run, identified and validated."""

import json
import os
from typing import TYPE_CHECKING

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import Json, Output, Seed

if TYPE_CHECKING:
    from steelyard.excitation.result import Designed
    from steelyard.excitation.trajectories.exact import ExactTrajectory
    from steelyard.robot_file.file import LoadedRobot

DESIGN = 8.0
"""Seconds that the design of the motion may take."""


@guarded
def demo(output: Output = None, seed: Seed = 0, as_json: Json = False) -> None:
    """Design a motion for an arm, run it, identify the arm from it, validate on another motion.

    Example: steelyard demo -o first-try
    """
    from rich.console import Console

    from steelyard.cli import interrupt
    from steelyard.cli.excite import results as design_results
    from steelyard.cli.excite import write_design
    from steelyard.cli.identify import results, run_identify
    from steelyard.cli.show import progress_bar
    from steelyard.excitation.design import design
    from steelyard.excitation.export.between_points import gaps_of_files
    from steelyard.excitation.search.parallel_search import Effort
    from steelyard.files import whole_folder
    from steelyard.identification.logs import model_of, new_folder
    from steelyard.report.terminal.design import design_summary
    from steelyard.report.terminal.terminal import summary
    from steelyard.virtual.demo import demo_runs

    folder = new_folder(output, "steelyard-demo")
    found: list[Designed] = []
    with progress_bar() as progress, whole_folder(folder) as part:

        def designed(loaded: "LoadedRobot") -> "ExactTrajectory":
            effort = Effort(DESIGN, processes=os.cpu_count() or 1, seed=seed)
            model = model_of(loaded)
            motion = design(loaded, model, effort, progress=progress)
            found.append(motion.with_gaps(gaps_of_files(motion, ("csv",), None)))
            (part / "motion").mkdir()
            write_design(found[0], loaded, part / "motion", ("csv",), None)
            return found[0].trajectory

        runs = demo_runs(part / "robot", seed, progress, design=designed)
        content, _ = run_identify(
            str(runs.robot),
            [str(runs.identification)],
            [str(runs.validation)],
            part / "results",
            os.cpu_count() or 1,
            progress,
            last=False,
        )
        interrupt.too_late()
    told = results(content, folder / "results")
    if as_json:
        motion = design_results(found[0]) | {"output": str(folder / "motion")}
        typer.echo(json.dumps(told | {"motion": motion}, allow_nan=False))
        return
    console = Console()
    design_summary(found[0], console)
    summary(content, console)
    typer.echo(
        "\nyour own robot: steelyard init URDF LOG, steelyard check ROBOT LOG..., then identify\n"
        f"\nrobot file, logs and the hidden truth  {folder / 'robot'}\n"
        f"designed motion and its report         {folder / 'motion' / 'report.html'}\n"
        f"model                                  {folder / 'results' / 'model.json'}\n"
        f"report                                 {folder / 'results' / 'report.html'}"
    )
