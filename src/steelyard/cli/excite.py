"""`steelyard excite`: design the motion that shows a robot's parameters best."""

import json
import os
import time
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from steelyard.cli.guard import guarded
from steelyard.cli.options import FixedBase, Json, Output, RobotArgument, Seed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from steelyard.excitation.result import Designed
    from steelyard.progress import Event, Progress
    from steelyard.robot_file.file import LoadedRobot

BUDGET = 10.0
"""Seconds of a design, if none are given."""

UNPROVEN = 1
"""Exit code where a limit or a constraint is not proven."""

UNCOVERED = 3
"""Exit code where all that was looked at is proven, but not everything was looked at."""


EXITS = {"good": 0, "fair": UNCOVERED, "poor": UNPROVEN}
"""Exit code by how good the certificate is."""


@guarded
def excite(
    robot: RobotArgument,
    motion: Annotated[
        str | None,
        typer.Option(
            help="Kind of motion: fourier, raw_fourier, blended_fourier, ramped_fourier, spline "
            "or reaching are optimised; pick_and_place, square, waypoints, sweeps, postures and "
            "replay are planned. By the robot file, or fourier.",
            metavar="KIND",
        ),
    ] = None,
    period: Annotated[
        float | None, typer.Option(help="Seconds of the motion, or of its period.")
    ] = None,
    harmonics: Annotated[int | None, typer.Option(help="Harmonics of a Fourier series.")] = None,
    criterion: Annotated[
        str | None,
        typer.Option(
            help="condition, normalised_condition, d_optimal, a_optimal or e_optimal.",
            metavar="KIND",
        ),
    ] = None,
    earlier: Annotated[
        Path | None,
        typer.Option(
            help="model.json of an earlier log: its noise says how well parameters will be shown, "
            "its values what torques to expect.",
            metavar="MODEL",
        ),
    ] = None,
    still_unknown: Annotated[
        bool,
        typer.Option(
            "--still-unknown", help="Show what the earlier log left unknown; needs --earlier."
        ),
    ] = False,
    method: Annotated[
        str | None, typer.Option(help="Search method: gradient, genetic or cma_es.", metavar="NAME")
    ] = None,
    budget: Annotated[
        float, typer.Option(min=1.0, help="Seconds that the design may take.")
    ] = BUDGET,
    searches: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Stop after so many searches: then the seed alone decides, if the budget "
            "is long enough.",
        ),
    ] = None,
    processes: Annotated[
        int | None, typer.Option(min=1, help="Processes that search; all cores if unset.")
    ] = None,
    formats: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            help="Write it for a controller too: csv, ros2, urscript, krl, rapid, mujoco.",
            metavar="NAME",
        ),
    ] = None,
    rate: Annotated[
        float | None, typer.Option(min=1.0, help="Points a second in those files.")
    ] = None,
    fixed_base: FixedBase = None,
    seed: Seed = 0,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Design the motion that shows a robot's parameters best, and prove that it keeps its limits.

    Limits, tool box, obstacles and what is to be shown stand in the robot file, in its
    excitation tables. Writes trajectory.json, certificate.json, trajectory.csv and report.html.
    Ctrl-C ends the search and keeps the best motion so far. Exit code 1: a planned motion does not
    keep everything; it is written, but no program for a controller. Exit code 3: all that was
    looked at is proven, but something was not looked at (a floor, links without shapes, torques),
    no search came to an end, or parameters are hidden behind others; everything is written, and the
    summary says what is not covered.

    Example: steelyard excite panda.toml --budget 20 -o panda-motion
    """
    begun = time.monotonic()
    from rich.console import Console

    from steelyard.cli import interrupt
    from steelyard.cli.show import progress_bar
    from steelyard.excitation.bases.families import FAMILIES
    from steelyard.excitation.design import design
    from steelyard.excitation.export.between_points import gaps_of_files
    from steelyard.excitation.search.parallel_search import Effort
    from steelyard.files import whole_folder
    from steelyard.identification.excitation_inputs import (
        asked,
        earlier_of,
        identified_before,
        refuse_formats,
    )
    from steelyard.identification.logs import model_of, new_folder, with_friction
    from steelyard.model import Model
    from steelyard.progress import Stopped
    from steelyard.report.terminal.design import design_summary
    from steelyard.report.text.design_words import level
    from steelyard.robot.xacro.read import stem_of
    from steelyard.robot_file.file import load_robot

    loaded = asked(
        load_robot(robot, base=fixed_base),
        motion=motion,
        period=period,
        harmonics=harmonics,
        criterion=criterion,
        method=method,
        still_unknown=still_unknown,
    )
    known = None if earlier is None else identified_before(earlier, loaded)
    model = with_friction(model_of(loaded), loaded)
    if known is not None:
        model = Model(loaded.robot, known.model.terms)
    forms = ("csv", *(formats or ()))
    refuse_formats(loaded, forms, rate)
    folder = new_folder(output, f"steelyard-{stem_of(robot)}-motion")
    effort = Effort(budget, searches, processes or os.cpu_count() or 1, seed)
    searched = loaded.excitation.motion.kind in FAMILIES
    try:
        with progress_bar() as progress, whole_folder(folder) as part:
            with interrupt.quietly() if searched else nullcontext():
                designed = design(
                    loaded,
                    model,
                    effort,
                    earlier=None if known is None else earlier_of(known),
                    progress=_ending(progress) if searched else progress,
                    since=begun,
                )
                if not designed.stopped:
                    interrupt.answered()
            gaps = gaps_of_files(designed, may_write(designed, forms), rate)
            designed = designed.with_gaps(gaps)
            files = write_design(designed, loaded, part, forms, rate)
            interrupt.too_late()
    except Stopped:
        interrupt.leave()
    written = {name: str(folder / path) for name, path in files.items()}
    if as_json:
        typer.echo(json.dumps(results(designed) | {"files": written}, allow_nan=False))
    else:
        design_summary(designed, Console())
        typer.echo("")
        for name, path in written.items():
            typer.echo(f"{name:<12} {path}")
        withheld = [form for form in forms if form not in may_write(designed, forms)]
        if withheld:
            typer.echo(
                f"not written  {', '.join(withheld)}: the motion is not proven, do not run it"
            )
    if code := EXITS[level(designed)]:
        raise typer.Exit(code)


def write_design(
    designed: "Designed",
    loaded: "LoadedRobot",
    folder: Path,
    formats: "Sequence[str]",
    rate: float | None,
) -> dict[str, str]:
    """Write a design into a new folder: what each file is, and its name."""
    from steelyard.excitation.export.export import write_export
    from steelyard.excitation.trajectories.files import write_motion
    from steelyard.report import render
    from steelyard.report.content import ReportContent

    write_motion(folder / "trajectory.json", designed.trajectory, designed.robot)
    designed.certificate.write(folder / "certificate.json")
    names = {"trajectory": "trajectory.json", "certificate": "certificate.json"}
    for form in may_write(designed, formats):
        path = write_export(designed.trajectory, designed.robot, form, folder, rate)
        names[form] = path.name
    title = f"A motion for {designed.robot.name}"
    content = ReportContent(
        title=title,
        robot=designed.robot.name,
        design=designed,
        workspace=loaded.excitation.workspace,
        files=tuple(names.items()),
    )
    (folder / "report.html").write_text(render(content), encoding="utf-8")
    return names | {"report": "report.html"}


def may_write(designed: "Designed", formats: "Sequence[str]") -> list[str]:
    """The formats that are written: no program for a controller of a motion that is not proven."""
    wanted = list(dict.fromkeys(formats))
    return wanted if designed.certificate.holds else [form for form in wanted if form == "csv"]


def results(designed: "Designed") -> dict[str, Any]:
    """A design as values for JSON."""
    from math import isfinite

    from steelyard.excitation.constraints.certificate import COVERS
    from steelyard.report.text.design_words import headline

    shown = designed.shown
    std = shown.std(designed.prior)
    return {
        "robot": designed.robot.name,
        "motion": designed.kind,
        "duration_s": designed.trajectory.duration,
        "criterion": designed.criterion,
        "figure": shown.figure if isfinite(shown.figure) else None,
        "condition": shown.raw if isfinite(shown.raw) else None,
        "condition_normalised": shown.normalised if isfinite(shown.normalised) else None,
        "certified": designed.certificate.holds,
        "headline": headline(designed),
        "covers": COVERS,
        "not_covered": list(designed.certificate.gaps),
        "not_covered_as_asked": list(designed.certificate.declined),
        "failures": list(designed.certificate.failures),
        "searches": designed.searches,
        "seconds": designed.seconds,
        "stopped": designed.stopped,
        "predicted_std": {
            name: float(value) if isfinite(value) else None
            for name, value in zip(shown.names, std, strict=True)
        },
        "noise": designed.noise_from,
        "notes": list(designed.notes),
    }


def _ending(progress: "Progress") -> "Progress":
    """A watcher that lets Ctrl-C end a search, and keeps what it has found."""
    from steelyard.cli import interrupt

    def watch(event: "Event") -> bool:
        if interrupt.asked():
            interrupt.answered()
            return False
        return progress(event)

    return watch
