"""What was found of actuators: their page, their text for the terminal and their JSON values."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from rich.console import Console
from rich.text import Text

from steelyard.actuators.actuator_model import ActuatorModel, ActuatorParameter
from steelyard.actuators.actuator_words_and_tables import (
    BRIEF,
    CLAIM,
    ActuatorVerdict,
    assumed_words,
    brief_tables,
    effort_words,
    efforts_table,
    errors_table,
    fitted_table,
    interval_words,
    law_lines,
    law_table,
    limit_words,
    logs_table,
    missed_words,
    open_words,
    parameters_tables,
    ratios_table,
    scale_words,
    verdict_of,
    weight_words,
)
from steelyard.actuators.choice import Rung
from steelyard.actuators.open_loop import OpenLoop
from steelyard.report.page import Shown, figures, notes, page_of
from steelyard.report.page_figures import (
    Figure,
    Frames,
    Group,
    Key,
    drawn,
    gaps,
    in_space,
    line,
    space_layout,
)
from steelyard.report.result import Result, print_verdict
from steelyard.report.tables import PlainTable, narrow_table
from steelyard.report.words import count
from steelyard.robot.robot import sticks, tips

POINTS = 1500  # of a line of a figure


class ActuatorResult(Result):
    """A model of actuators with the errors of logs predicted from their targets."""

    model: ActuatorModel
    validation: tuple[OpenLoop, ...]
    notes: tuple[str, ...]

    @property
    def verdict(self) -> ActuatorVerdict:
        """How well the model predicts, in one line."""
        return verdict_of(self.model, self.validation, "on motion that was not fitted")

    @property
    def warnings(self) -> tuple[str, ...]:
        """What qualifies the headline."""
        return ()


@dataclass(frozen=True, eq=False, repr=False)
class ActuatorIdentification(ActuatorResult):
    """Identified actuators, and how well targets alone predict positions.

    Attributes:
        model: Robot, law and values.
        validation: Errors of logs that were not fitted.
        fitted: Errors of those that were.
        law: Laws that were tried, by left-out motion.
        notes: What was assumed or found, one sentence each.

    Example:
        >>> found = identify_actuators("servo.toml", "servo_fit.csv", "servo_other.csv")
        >>> found.verdict.level
        'good'
    """

    model: ActuatorModel
    validation: tuple[OpenLoop, ...]
    fitted: tuple[OpenLoop, ...]
    law: tuple[Rung, ...]
    notes: tuple[str, ...]

    @property
    def verdict(self) -> ActuatorVerdict:
        """How well the model predicts, in one line."""
        if self.validation:
            return verdict_of(self.model, self.validation, "on motion that was not fitted")
        found = verdict_of(self.model, self.fitted, "on the fitted motion")
        line = f"{found.line}; no log validates it"
        return ActuatorVerdict("none", line, found.share, False)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What qualifies the headline: what cannot be right, is not described, or is open."""
        every = (*self.fitted, *self.validation)
        return (
            *limit_words(self.model, every),
            *missed_words(self.model, every),
            *weight_words(self.model),
            *effort_words(self.model),
            *open_words(self.model),
        )

    @property
    def basis(self) -> tuple[str, ...]:
        """What the values rest on: scale, and intervals."""
        return (
            scale_words(self.model),
            interval_words(self.model),
            *assumed_words(self.model),
        )

    @cached_property
    def parameters(self) -> tuple[ActuatorParameter, ...]:
        """All parameters of the law, with 95 % intervals."""
        return self.model.parameters

    def to_dict(self) -> dict[str, Any]:
        """The verdict, the parameters, the laws tried, and the errors of all logs."""
        joints = self.model.joints
        return {
            "verdict": self.verdict.to_dict(),
            "parameters": [one.to_dict() for one in self.parameters],
            "efforts": [one.to_dict() for one in self.model.efforts],
            "signs": dict(zip(joints, self.model.values.signs.tolist(), strict=True)),
            "law": [rung.to_dict() for rung in self.law],
            "validation": [_log_dict(one, joints, fitted=False) for one in self.validation],
            "fitted": [_log_dict(one, joints, fitted=True) for one in self.fitted],
            "warnings": [*self.warnings, *self.basis],
            "notes": list(self.notes),
        }

    def write(self, folder: Path) -> None:
        """Write `model.json` and the page."""
        (folder / "model.json").write_text(self.model.text(), encoding="utf-8")
        super().write(folder)

    def show(self, console: Console, verbose: bool = False) -> None:
        """Print the headline, errors and parameters."""
        _print(console, self, self.validation or self.fitted)
        tables = parameters_tables(self.model) if verbose else brief_tables(self.model)
        for table in tables:
            console.print(narrow_table(table))
        console.print(Text(tables[0].words if verbose else BRIEF))
        if self.model.efforts:
            console.print(narrow_table(efforts_table(self.model)))
        for words in self.basis:
            console.print(Text(f"- {words}"))
        for words in law_lines(self.model, self.law):
            console.print(Text(words))
        more = (*(note for note in self.notes if note not in self.warnings),)
        for note in more if verbose else more[:4]:
            console.print(Text(f"note {note}"), soft_wrap=True)
        if not verbose and len(more) > 4:
            console.print(Text(f"note {count(len(more) - 4, 'more note')} with --verbose"))
        if verbose:
            console.print(narrow_table(ratios_table(self.model)))
            console.print(narrow_table(law_table(self.law)))
            console.print(Text(law_table(self.law).words))

    @property
    def _tables(self) -> list[PlainTable]:
        """Parameters, and gains of efforts that are logged."""
        efforts = [efforts_table(self.model)] if self.model.efforts else []
        return parameters_tables(self.model) + efforts

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        shown = self.validation or self.fitted
        return page_of(
            f"{self.model.robot.name}: actuators",
            self.model.robot.name,
            (
                *_error_sections(self, shown, shown),
                figures("parameters", "Parameters", tables=self._tables),
                notes("basis", "What the parameters rest on", self.basis),
                figures("ratios", "Ratios to the stiffness", tables=[ratios_table(self.model)]),
                figures(
                    "law",
                    "The law",
                    words=" ".join(f"{one}." for one in law_lines(self.model, self.law)),
                    tables=[law_table(self.law)],
                ),
                replay_section(self.model, shown[0]),
                *_motion_sections(self.model, shown),
                figures("logs", "Fitted logs", tables=[fitted_table(self.fitted)]),
                notes("notes", "Notes", self.notes, folded=True),
            ),
        )


@dataclass(frozen=True, eq=False, repr=False)
class ActuatorValidation(ActuatorResult):
    """Errors of positions that a model predicts from targets.

    Attributes:
        model: The model.
        validation: Errors of the logs, in their order.
        fitted: Names of the logs that the model was fitted to.
        notes: What was left out of the logs.
    """

    model: ActuatorModel
    validation: tuple[OpenLoop, ...]
    fitted: tuple[str, ...]
    notes: tuple[str, ...]

    json_name: ClassVar[str] = "validation.json"

    @property
    def fresh(self) -> tuple[OpenLoop, ...]:
        """Errors of the logs that were not fitted."""
        return tuple(one for one in self.validation if one.log not in self.fitted)

    @property
    def verdict(self) -> ActuatorVerdict:
        """How well the model predicts, in one line."""
        if self.fresh:
            return verdict_of(self.model, self.fresh, "on motion that was not fitted")
        found = verdict_of(self.model, self.validation, "on the fitted motion")
        return ActuatorVerdict("none", f"{found.line}; no log validates it", found.share, False)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the model does not describe or know, and logs that were fitted."""
        again = (f"{name} was fitted: it does not validate the model" for name in self.fitted)
        found = (limit_words, missed_words)
        words = (x for of in found for x in of(self.model, self.validation))
        return (*words, *open_words(self.model), *again)

    def to_dict(self) -> dict[str, Any]:
        """The verdict, and under `logs` the errors of each log."""
        joints = self.model.joints
        logs = [_log_dict(x, joints, fitted=x.log in self.fitted) for x in self.validation]
        return {"verdict": self.verdict.to_dict(), "logs": logs, "notes": list(self.notes)}

    def show(self, console: Console, verbose: bool = False) -> None:
        """Print the headline and the errors."""
        _print(console, self, self.fresh or self.validation)
        if len(self.validation) > 1:
            console.print(narrow_table(logs_table(self.model, self.validation, self.fitted)))
        for note in self.notes:
            console.print(Text(f"note {note}"), soft_wrap=True)

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        return page_of(
            f"{self.model.robot.name}: actuators, validation",
            self.model.robot.name,
            (
                *_error_sections(self, self.fresh or self.validation, self.validation, self.fitted),
                replay_section(self.model, (self.fresh or self.validation)[0]),
                *_motion_sections(self.model, self.validation),
                notes("notes", "Notes", self.notes, folded=True),
            ),
        )


def _log_dict(one: OpenLoop, joints: Sequence[str], *, fitted: bool) -> dict[str, Any]:
    return {
        "run": one.log,
        "fitted": fitted,
        "seconds": one.seconds,
        "open_loop": one.to_dict(joints),
    }


def _print(console: Console, found: ActuatorResult, shown: Sequence[OpenLoop]) -> None:
    verdict, name = found.verdict, found.model.robot.name
    console.print(Text(f"{name}: actuators"), style="dim")
    label = "" if verdict.level == "none" else f"{verdict.level.upper()}  "
    print_verdict(console, label + verdict.line, CLAIM, found.warnings)
    console.print(narrow_table(errors_table(found.model, shown)))


def _error_sections(
    result: ActuatorResult,
    shown: Sequence[OpenLoop],
    every: Sequence[OpenLoop],
    fitted: Sequence[str] = (),
) -> Iterator[Any]:
    """Errors of what counts, all logs one by one, and what qualifies them."""
    verdict = result.verdict
    label = "" if verdict.level == "none" else f"{verdict.level.upper()}: "
    tables = [errors_table(result.model, shown)]
    tables += [logs_table(result.model, every, fitted)] if len(every) > 1 else []
    yield figures("errors", "Open loop", words=f"{label}{verdict.line}. {CLAIM}", tables=tables)
    yield notes("limits", "Limits of this result", result.warnings)


SHOWN_LOGS = 6  # whose motion the page shows
REPLAYED, REPLAY_RATE = 60.0, 10.0  # seconds of the replay, and its frames a second


def replay_section(model: ActuatorModel, one: OpenLoop) -> Shown:
    """The measured and the predicted arm in space, in the model's joints: the longest run."""
    edges = [0, *(gaps(one.t) + 1).tolist(), len(one.t)]
    run = max(map(slice, edges[:-1], edges[1:]), key=lambda rows: rows.stop - rows.start)
    given = one.t[run]
    t = np.arange(given[0], min(given[-1], given[0] + REPLAYED), 1.0 / REPLAY_RATE)
    values, arms = model.values, []
    for q in (one.q[run], one.predicted[run]):
        rows = np.stack([np.interp(t, given, x) for x in q.T], axis=1)
        moved = values.signs * rows + values["zero"]
        arms.append(np.concatenate([sticks(model.robot, moved), tips(model.robot, moved)], axis=1))
    ends = np.concatenate(arms).reshape(-1, 3)
    spans = zip(("xaxis", "yaxis", "zaxis"), np.nanmin(ends, 0), np.nanmax(ends, 0), strict=True)
    fixed: dict[str, Any] = {a: {"range": [low - 0.02, high + 0.02]} for a, low, high in spans}
    fixed["camera"] = {"eye": {"x": 1.6, "y": -1.7, "z": 0.8}}
    named = (("measured", "--measured", 9), ("predicted from targets", "--predicted", 4))
    traces = [
        in_space(
            name,
            arm[0],
            mode="lines+markers",
            line={"color": colour, "width": width},
            marker={"color": colour, "size": 3},
            hoverinfo="skip",
        )
        for arm, (name, colour, width) in zip(arms, named, strict=True)
    ]
    label = f"Measured and predicted arm in space along {one.log}"
    figure = Figure(one.log, label, "", "", traces, space_layout(**fixed))
    note = (
        "Lines from joint to joint, and to the centres of mass of the last links, in the frame of "
        "the base, with the signs and zeros of this model: if the arm stands otherwise than yours "
        "did, these are wrong. A link that turns about its own line is not seen to. Drag to turn "
        "the picture."
    )
    return figures(
        "replay",
        "Replay",
        legend=[Key(colour, name) for name, colour, _ in named],
        groups=[Group([replace(figure, frames=Frames(t - t[0], arms))], columns="one")],
        note=note,
    )


def _motion_sections(model: ActuatorModel, shown: Sequence[OpenLoop]) -> Iterator[Any]:
    """Positions, and their errors on a scale of their own."""
    some = shown[:SHOWN_LOGS]
    note = f"The first {SHOWN_LOGS} of {len(shown)} logs." if len(shown) > SHOWN_LOGS else ""
    joints = range(model.robot.n)
    yield figures(
        "motion-error",
        "Error over time",
        legend=[Key("--residual", "measured less predicted position")],
        groups=[Group([_error_figure(model, one, j) for j in joints], one.log) for one in some],
        note=note,
    )
    yield figures(
        "motion",
        "Measured and predicted motion",
        legend=[
            Key("--measured", "measured"),
            Key("--predicted", "predicted from targets"),
            Key("--interval", "target"),
        ],
        groups=[Group([_figure(model, one, j) for j in joints], one.log) for one in some],
        note=note,
    )


def _error_figure(model: ActuatorModel, one: OpenLoop, j: int) -> Figure:
    t, y = drawn(one.t, 1e3 * (one.q[:, j] - one.predicted[:, j]), POINTS)
    label = f"Error of the predicted position of {model.joints[j]} in {one.log}"
    unit = "mrad" if model.robot.coordinates[j].kind == "revolute" else "mm"
    traces = [line("error", t, y, "--residual", width=1.2)]
    more = {"showlegend": False}
    return Figure(model.joints[j], label, "time [s]", f"error [{unit}]", traces, more)


def _figure(model: ActuatorModel, one: OpenLoop, j: int) -> Figure:
    joint, unit = model.joints[j], model.robot.coordinates[j].unit
    traces = []
    for name, x, colour in (
        ("target", one.target, "--interval"),
        ("measured", one.q, "--measured"),
        ("predicted", one.predicted, "--predicted"),
    ):
        t, y = drawn(one.t, x[:, j], POINTS)
        traces.append(line(name, t, y, colour, width=1.2))
    label = f"Measured and predicted position of {joint} in {one.log}"
    more = {"showlegend": False}
    return Figure(joint, label, "time [s]", f"position [{unit}]", traces, more)
