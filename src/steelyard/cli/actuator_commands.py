"""What `identify`, `validate` and `export` do where joints follow position targets."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import typer

from steelyard.cli import interrupt
from steelyard.cli.shared_by_commands import (
    computed,
    file_lines,
    print_json,
    refuse_options,
    say,
    show,
)

OF_EFFORTS = (
    *("loaded", "payload_mass", "payload_frame", "commanded", "sensitivity", "bootstrap"),
    *("each", "method", "cluster"),
)
"""Options of `identify` that only efforts make sense of."""


def follows_targets(robot: str) -> bool:
    """Whether the actuators of a robot file are identified, from its position targets."""
    from steelyard.robot.file.robot_file import load_robot

    return Path(robot).suffix.lower() == ".toml" and load_robot(robot).targets is not None


def actuators_identified(
    given: Mapping[str, Any], folder: Path, verbose: bool, as_json: bool
) -> None:
    """Identify actuators with the arguments of `identify`, and print what was found."""
    from steelyard.actuators.identify_actuators import identify_actuators
    from steelyard.identify.verdict_and_next_steps import path_word, step_lines

    options = {f"--{name.replace('_', '-')}": given.get(name) for name in OF_EFFORTS}
    options["--no-check"] = not given.get("check", True)
    refuse_options(
        options,
        "is for identification from efforts, and the robot file is for actuators",
        "leave it out, or log efforts, add [signals.effort] and remove [actuator]",
    )
    known = ("robot", "logs", "validate", "fixed_base", "threads")
    call = partial(identify_actuators, **{name: given[name] for name in known if name in given})
    found = computed(call, folder)
    if as_json:
        print_json({"output": str(folder), **found.to_dict()})
    else:
        show(found, verbose)
        name = path_word(str(folder))
        steps = (
            (f"steelyard validate {name} OTHER_LOG", "error on another motion"),
            (f"steelyard export {name} --to mjcf", "the arm with its actuators for MuJoCo"),
        )[: 1 if found.model.beyond_limits else 2]
        paths = file_lines(folder, model="model.json", report="report.html")
        typer.echo("\n".join(["", *step_lines(steps), paths]))
    raise typer.Exit(int(found.verdict.level == "poor"))


def targets_checked(
    given: Mapping[str, Any], folder: Path | None, verbose: bool, as_json: bool
) -> None:
    """Check logs of targets with the arguments of `check`, and print what was found."""
    from steelyard.actuators.check_targets import check_targets
    from steelyard.identify.verdict_and_next_steps import identify_command, step_lines
    from steelyard.report.terminal import terminal
    from steelyard.robot.file.robot_file import load_robot

    refuse_options(
        {
            "--model": given.get("model"),
            "--fix": given.get("fix") is not None,
            "--quick": given.get("quick"),
            "--cluster": given.get("cluster"),
        },
        "is for identification from efforts, and the robot file is for actuators",
        "leave it out",
    )
    load_robot(given["robot"], base=given.get("fixed_base"))
    call = partial(check_targets, robot=given["robot"], logs=given["logs"])
    found = computed(call, folder)
    severity = found.last.severity
    if as_json:
        print_json({**found.to_dict(), "output": folder and str(folder)})
    else:
        found.show(terminal(), verbose)
        steps = [] if severity else [(identify_command(given["robot"], given["logs"]), "")]
        paths = [file_lines(folder, page="check.html", JSON="check.json")] if folder else []
        typer.echo("\n".join(["", *paths, *step_lines(tuple(steps), 12)]))
    raise typer.Exit(int(severity))


def actuators_validated(
    given: Mapping[str, Any],
    folder: Path | None,
    max_error: float | None,
    verbose: bool,
    as_json: bool,
) -> None:
    """Validate actuators with the arguments of `validate`, and print what was found."""
    from steelyard.actuators.identify_actuators import validate_actuators

    refuse_options(
        {"--commanded": given.get("commanded")},
        "is for efforts: positions are always predicted from targets here",
        "leave it out",
    )
    known = ("model", "logs")
    call = partial(validate_actuators, **{name: given[name] for name in known})
    found = computed(call, folder)
    verdict = found.verdict
    if as_json:
        print_json(found.to_dict()["logs"])
    else:
        show(found, verbose)
        if folder is not None:
            typer.echo("\n" + file_lines(folder, report="report.html", JSON="validation.json"))
    share = None if verdict.share is None else 100.0 * verdict.share
    above = max_error is not None and (not found.fresh or share is None or share > max_error)
    if above and not as_json:
        said = "no log has unseen motion" if share is None or not found.fresh else f"{share:.3g} %"
        typer.echo(f"\nabove --max-error: {said}, at most {max_error:g} %")
    raise typer.Exit(int(above or verdict.level == "poor"))


def actuators_exported(
    model: str, form: str, output: Path | None, units: Sequence[str], as_json: bool
) -> None:
    """Write identified actuators for a simulator, and print what the file lacks."""
    from steelyard.actuators.actuator_model import load_actuators
    from steelyard.actuators.ranges_of_units import qualified, ranges_of_units, words_of_ranges
    from steelyard.base.errors import OutputError
    from steelyard.base.files import refuse_existing, whole_file
    from steelyard.export.model_files.actuators_mjcf import ActuatorFile, actuators_mjcf
    from steelyard.export.model_files.actuators_python import actuators_python
    from steelyard.export.model_files.actuators_usd import actuators_usd

    writers: dict[str, tuple[str, str, Callable[..., ActuatorFile]]] = {
        "mjcf": ("MJCF", ".xml", actuators_mjcf),
        "usd": ("USD", ".usda", actuators_usd),
        "isaaclab": ("Isaac Lab", "_isaaclab.py", partial(actuators_python, framework="isaaclab")),
        "mjlab": ("mjlab", "_mjlab.py", partial(actuators_python, framework="mjlab")),
    }
    if form not in writers:
        raise OutputError(
            f"a model of actuators is not written as {form}",
            where="--to",
            fix=f"give --to {', '.join(writers)}: position actuators with delay, armature and dry "
            "friction",
        )
    name, ending, write = writers[form]
    known = load_actuators(model)
    path = output or Path(f"{known.robot.name}{ending}".replace("/", "_")).absolute()
    refuse_existing(path)
    models = [known, *(load_actuators(unit) for unit in units)]
    ranges = ranges_of_units(models) if units else ()
    made = write(known, units=words_of_ranges(ranges, models) if units else ())
    with whole_file(path) as part:
        part.write_text(made.text, encoding="utf-8", newline="")
        interrupt.too_late()
    if as_json:
        found: dict[str, Any] = {
            "file": str(path),
            "format": form,
            "unsupported": list(made.unsupported),
        }
        if units:
            found |= {"ranges": [vars(one) for one in ranges], "notes": qualified(models)}
        print_json(found)
        return
    say(f"{path}: {len(known.joints)} position actuators; its head says how to convert targets")
    if units:
        differ = ", ".join(dict.fromkeys(one.name for one in ranges if one.differ)) or "nothing"
        say(f"{len(ranges)} values with ranges over {len(models)} robots, which differ in {differ}")
        for sentence in qualified(models):
            say(sentence)
    for sentence in made.unsupported:
        say(f"{name} cannot represent: {sentence}")
