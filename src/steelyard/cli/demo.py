"""`steelyard demo`: an arm of our own, simulated, identified and validated."""

import json
import os
from pathlib import Path

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import Json, Output, Seed


@guarded
def demo(output: Output = None, seed: Seed = 0, as_json: Json = False) -> None:
    """Simulate an arm, identify it from one motion, validate it on another.

    Example: steelyard demo -o first-try
    """
    from rich.console import Console

    from steelyard.cli import interrupt, river
    from steelyard.cli.identify import results, run_identify
    from steelyard.cli.show import progress_bar
    from steelyard.files import whole_folder
    from steelyard.report.terminal import summary
    from steelyard.virtual.demo import demo_runs

    folder = river.new_folder(output, "steelyard-demo")
    with progress_bar() as progress, whole_folder(folder) as part:
        runs = demo_runs(part / "robot", seed, progress)
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
    if as_json:
        typer.echo(json.dumps(results(content, folder / "results"), allow_nan=False))
        return
    summary(content, Console())
    typer.echo(
        "\nyour own robot: steelyard init URDF LOG, steelyard check ROBOT LOG..., then identify\n"
        f"\nrobot file, logs and the hidden truth  {folder / 'robot'}\n"
        f"model                                  {folder / 'results' / 'model.json'}\n"
        f"report                                 {Path(folder) / 'results' / 'report.html'}"
    )
