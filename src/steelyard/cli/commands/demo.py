"""`steelyard demo`: an arm of our own; its motion designed, run, identified and validated."""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import Details, Json, Seed, output_folder

if TYPE_CHECKING:
    from rich.console import Console

    from steelyard.excitation.trajectories.exact import ExactTrajectory
    from steelyard.identification.identify import Identification
    from steelyard.identification.motion.design import DesignedMotion
    from steelyard.robot_file.loaded import LoadedRobot

SEARCHES = 2
"""Searches after which the design of the motion ends, on a busy machine as well."""

DESIGN = 120.0
"""Seconds after which it ends in any case."""


@guarded
def demo(
    output: Annotated[Path | None, output_folder("steelyard-demo")] = None,
    seed: Seed = 0,
    verbose: Details = False,
    as_json: Json = False,
) -> None:
    """Demonstration on a simulated arm: design a motion, identify, validate.

    Example: steelyard demo -o first-try
    """
    from rich.console import Console

    from steelyard.cli import interrupt
    from steelyard.cli.show import progress_bar
    from steelyard.excitation.search.parallel_search import SearchBudget
    from steelyard.files import new_folder, whole_folder
    from steelyard.identification.described_model import model_with_open_friction
    from steelyard.identification.identify import identify
    from steelyard.identification.motion.design import DesignedMotion, DesignTask
    from steelyard.virtual.demo import demo_runs, true_parameters

    folder = new_folder(output, "steelyard-demo")
    found: list[DesignedMotion] = []
    with progress_bar() as progress, whole_folder(folder) as part:

        def designed(loaded: "LoadedRobot") -> "ExactTrajectory":
            effort = SearchBudget(DESIGN, SEARCHES, os.cpu_count() or 1, seed)
            task = DesignTask(loaded, model_with_open_friction(loaded), None, ("csv",), None)
            found.append(task.done(effort, progress=progress))
            (part / "motion").mkdir()
            found[0].write(part / "motion")
            return found[0].trajectory

        runs = demo_runs(part / "robot", seed, progress, design=designed)
        identified = identify(
            runs.robot, runs.identification, validate=runs.validation, progress=progress
        )
        identified = identified.beside(true_parameters(runs))
        (part / "results").mkdir()
        identified.write(part / "results")
        interrupt.too_late()
    if as_json:
        motion = found[0].to_dict() | {"output": str(folder / "motion")}
        content = {"output": str(folder / "results"), **identified.to_dict(), "motion": motion}
        typer.echo(json.dumps(content, allow_nan=False))
        return
    console = Console()
    if verbose:
        found[0].show(console, verbose)
        console.print()
        identified.show(console, verbose)
    else:
        _show(found[0], identified, console)
    typer.echo(
        "\nyour own robot: steelyard init URDF LOG, steelyard check ROBOT LOG..., then identify\n"
        f"robot file, logs, true parameters      {folder / 'robot'}\n"
        f"designed motion and its report         {folder / 'motion' / 'report.html'}\n"
        f"model                                  {folder / 'results' / 'model.json'}\n"
        f"report                                 {folder / 'results' / 'report.html'}"
    )


def _show(motion: "DesignedMotion", found: "Identification", console: "Console") -> None:
    """Print whether the motion is safe, the error of the model, and how near it is to the truth."""
    from rich.text import Text

    from steelyard.report.sections.model.truth import TruthSection
    from steelyard.report.sections.model.verdict import VerdictSection
    from steelyard.report.text.design_words import headline

    console.print(Text(headline(motion.designed)))
    parts = [
        part
        for section in (VerdictSection(), TruthSection())
        for part in section.printed(found.content)
    ]
    for number, part in enumerate(parts):
        if number:
            console.print()
        console.print(part)
