"""What was found of actuators: their page, their text for the terminal and their JSON values."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from rich.console import Console
from rich.text import Text

from steelyard.actuators.actuator_model import ActuatorModel, ActuatorParameter
from steelyard.actuators.actuator_parameters import KINDS
from steelyard.actuators.choice import Rung
from steelyard.actuators.open_loop import AFTER, OpenLoop, tool_body
from steelyard.base.arrays import Z95, Array
from steelyard.report.page import figures, inspected_page, notes
from steelyard.report.page_figures import Figure, Group, Key, drawn, line
from steelyard.report.result import Result, print_verdict
from steelyard.report.tables import PlainTable, Row, narrow_table
from steelyard.report.words import NONE, Level, count, significant

GOOD, FAIR = 0.35, 0.8
"""Mean error over that of "position = target", up to which a model is good, or fair."""
POINTS = 1500  # of a line of a figure
STILL = 1e-4  # error of "position = target" of a joint that does not move [rad; m]


@dataclass(frozen=True)
class ActuatorVerdict:
    """The headline: how far off motion is, and what that rests on."""

    level: Level
    line: str
    share: float | None
    unseen: bool

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "level": self.level,
            "line": self.line,
            "share_of_position_is_target": self.share,
            "unseen": self.unseen,
        }


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
        """Where the scale comes from, what logs do not show, and open signs."""
        open_signs = [note for note in self.notes if "not decided" in note]
        return (scale_words(self.model), *unknown_words(self.model), *open_signs)

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
            "signs": dict(zip(joints, self.model.values.signs.tolist(), strict=True)),
            "law": [rung.to_dict() for rung in self.law],
            "validation": [_log_dict(one, joints, fitted=False) for one in self.validation],
            "fitted": [_log_dict(one, joints, fitted=True) for one in self.fitted],
            "warnings": list(self.warnings),
            "notes": list(self.notes),
        }

    def write(self, folder: Path) -> None:
        """Write `model.json` and the page."""
        (folder / "model.json").write_text(self.model.text(), encoding="utf-8")
        super().write(folder)

    def show(self, console: Console, verbose: bool = False) -> None:
        """Print the headline, errors and parameters."""
        _print(console, self)
        table = parameters_table(self.model) if verbose else brief_table(self.model)
        console.print(narrow_table(table))
        for one in (p for p in self.parameters if p.joint == "all" and p.interval):
            console.print(Text(f"{one.name}  {_value(one)} {one.unit}, of all joints"))
        console.print(Text(f"law  {law_words(self.law)}"))
        more = (*(note for note in self.notes if note not in self.warnings),)
        for note in more if verbose else more[:4]:
            console.print(Text(f"note {note}"), soft_wrap=True)
        if not verbose and len(more) > 4:
            console.print(Text(f"note {count(len(more) - 4, 'more note')} with --verbose"))
        if verbose:
            console.print(narrow_table(ratios_table(self.model)))
            console.print(narrow_table(law_table(self.law)))

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        shown = self.validation or self.fitted
        return inspected_page(
            f"{self.model.robot.name}: actuators",
            self.model.robot.name,
            (
                *_error_sections(self, shown),
                figures("parameters", "Parameters", tables=[parameters_table(self.model)]),
                figures("ratios", "Ratios to the stiffness", tables=[ratios_table(self.model)]),
                figures("law", "Choice of the law", tables=[law_table(self.law)]),
                _motion_section(self.model, shown),
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
    def unseen(self) -> bool:
        """Whether some log was not fitted."""
        return any(one.log not in self.fitted for one in self.validation)

    @property
    def verdict(self) -> ActuatorVerdict:
        """How well the model predicts, in one line."""
        fresh = tuple(one for one in self.validation if one.log not in self.fitted)
        if fresh:
            return verdict_of(self.model, fresh, "on motion that was not fitted")
        found = verdict_of(self.model, self.validation, "on the fitted motion")
        return ActuatorVerdict("none", f"{found.line}; no log validates it", found.share, False)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Logs that were fitted."""
        return tuple(f"{name} was fitted: it does not validate the model" for name in self.fitted)

    def to_dict(self) -> dict[str, Any]:
        """The verdict, and under `logs` the errors of each log."""
        joints = self.model.joints
        logs = [_log_dict(x, joints, fitted=x.log in self.fitted) for x in self.validation]
        return {"verdict": self.verdict.to_dict(), "logs": logs, "notes": list(self.notes)}

    def show(self, console: Console, verbose: bool = False) -> None:
        """Print the headline and the errors."""
        _print(console, self)
        if len(self.validation) > 1 or verbose:
            console.print(narrow_table(logs_table(self.model, self.validation)))
        for note in self.notes:
            console.print(Text(f"note {note}"), soft_wrap=True)

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        return inspected_page(
            f"{self.model.robot.name}: actuators, validation",
            self.model.robot.name,
            (
                *_error_sections(self, self.validation),
                _motion_section(self.model, self.validation),
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


def together(found: Sequence[OpenLoop], name: str = "rms") -> Array:
    """Root mean square over logs of an error by joint, by their lengths, `(n,)`."""
    weight = np.array([one.seconds for one in found])
    squares = np.array([getattr(one, name) ** 2 for one in found])
    return np.asarray(np.sqrt(weight @ squares / weight.sum()))


def verdict_of(model: ActuatorModel, found: Sequence[OpenLoop], where: str) -> ActuatorVerdict:
    """Errors of all joints against those of "position = target"."""
    rms, target = together(found), together(found, "target_rms")
    moves = target > STILL
    share = float(np.mean(rms[moves] / target[moves])) if moves.any() else None
    level: Level = "none"
    if share is not None:
        level = "good" if share <= GOOD else "fair" if share <= FAIR else "poor"
    worst = int(np.argmax(np.where(moves, rms, -1.0)))
    mean = f"{_size(model, rms.mean())} mean over {count(len(rms), 'joint')}, "
    if len({c.kind for c in model.robot.coordinates}) > 1:
        mean = ""
    line = (
        f"open loop {where}: {mean}{_size(model, rms[worst], worst)} of {model.joints[worst]}, "
        "the worst"
    )
    if share is not None:
        line += f'; {share:.0%} of the error of "position = target"'
    return ActuatorVerdict(level, line, share, True)


def _size(model: ActuatorModel, error: float, joint: int = 0) -> str:
    unit = "mrad" if model.robot.coordinates[joint].kind == "revolute" else "mm"
    return f"{significant(1e3 * float(error))} {unit}"


def scale_words(model: ActuatorModel) -> str:
    """Where stiffness and friction have their scale from."""
    if "stiffness" in model.stated:
        return "torques have the scale of the stiffness that is stated"
    return (
        "torques, stiffness and inertia have the scale of the masses in the model file: if these "
        "are off by 10 %, so are all; ratios and the error above are not"
    )


def unknown_words(model: ActuatorModel) -> tuple[str, ...]:
    """Parameters that the logs do not show, by name."""
    by: dict[str, list[str]] = {}
    for one in model.parameters:
        if one.status == "not identifiable" and one.name not in ("offset", "zero"):
            by.setdefault(one.name, []).append(one.joint)
    if not by:
        return ()
    listed = "; ".join(f"{name} of {', '.join(joints)}" for name, joints in by.items())
    return (f"not identifiable from these logs (wide intervals, marked ?): {listed}",)


def _print(console: Console, found: ActuatorResult) -> None:
    verdict, name = found.verdict, found.model.robot.name
    shown = found.validation or getattr(found, "fitted", ())
    console.print(Text(f"{name}: actuators"), style="dim")
    label = "" if verdict.level == "none" else f"{verdict.level.upper()}  "
    print_verdict(console, label + verdict.line, _claim(), found.warnings)
    console.print(narrow_table(errors_table(found.model, shown)))


def _claim() -> str:
    return (
        "Positions are predicted from the targets alone, from the first row on: root mean squares. "
        "Drift: some time after a measured state."
    )


def errors_table(model: ActuatorModel, found: Sequence[OpenLoop]) -> PlainTable:
    """Errors by joint, all logs together."""
    rms, target = together(found), together(found, "target_rms")
    rows = []
    for j, joint in enumerate(model.joints):
        drifts = [_drift(found, after, j) for after in AFTER]
        cells = [_milli(rms[j]), _milli(target[j]), *drifts]
        rows.append(Row((joint, *cells)))
    weight = np.array([one.seconds for one in found])
    tool, meant = (
        float(np.sqrt(weight @ np.array([getattr(one, name) ** 2 for one in found]) / weight.sum()))
        for name in ("tool", "target_tool")
    )
    last = [_drift(found, after, None) for after in AFTER]
    rows.append(Row(("tool [mm]", _milli(tool), _milli(meant), *last), total=True))
    name = model.robot.bodies[tool_body(model.robot)].name
    units = "mrad" if all(c.kind == "revolute" for c in model.robot.coordinates) else "mrad; mm"
    headings = ("joint", f"rms [{units}]", "position = target")
    words = f'The tool is the origin of "{name}".'
    return PlainTable("", words, (*headings, *(f"after {x:g} s" for x in AFTER)), rows)


def _milli(x: float) -> str:
    """A thousandth is the unit; less than a thousandth of it is nothing."""
    return significant(1e3 * float(x)) if abs(x) >= 1e-6 else "0"


def _drift(found: Sequence[OpenLoop], after: float, joint: int | None) -> str:
    known = [
        (one.seconds, x.tool if joint is None else float(x.rms[joint]))
        for one in found
        for x in one.drift
        if x.after == after
    ]
    if not known:
        return NONE
    weight, value = np.array(known).T
    return _milli(float(np.sqrt(weight @ value**2 / weight.sum())))


def logs_table(model: ActuatorModel, found: Sequence[OpenLoop]) -> PlainTable:
    """Errors of each log, joint by joint."""
    rows = [Row((one.log, *(_milli(x) for x in one.rms), _milli(one.tool))) for one in found]
    return PlainTable("By log", "", ("log", *model.joints, "tool [mm]"), rows)


def parameters_table(model: ActuatorModel) -> PlainTable:
    """A row per joint, a column per parameter of the law, with 95 % intervals."""
    used = [k for k in KINDS if any(p.name == k.name and p.interval for p in model.parameters)]
    used += [k for k in KINDS if k not in used and k.name in model.stated]
    own = [k for k in used if not k.common]
    rows = []
    for joint in model.joints:
        mine = {p.name: p for p in model.parameters if p.joint == joint}
        rows.append(Row((joint, *(_value(mine[k.name]) for k in own))))
    headings = ("joint", *(f"{k.name.replace('_', ' ')} [{k.unit}]" for k in own))
    common = [p for p in model.parameters if p.joint == "all" and p.interval]
    words = "".join(f" The {p.name} of all joints is {_value(p)} {p.unit}." for p in common)
    told = f"95 % intervals in brackets; ? where the logs do not show the value.{words}"
    return PlainTable("", told, headings, rows)


def _value(one: ActuatorParameter) -> str:
    if one.interval is None:
        return f"{significant(one.value)} (stated)" if one.status == "stated" else NONE
    low, high = one.interval
    mark = " ?" if one.status == "not identifiable" else ""
    return f"{significant(one.value)} [{significant(low, 2)}, {significant(high, 2)}]{mark}"


def brief_table(model: ActuatorModel) -> PlainTable:
    """The parameters of the law in few columns, for the terminal: `?` for wide intervals."""
    used = [
        k
        for k in KINDS
        if k.positive and any(p.name == k.name and p.interval for p in model.parameters)
    ]
    rows = []
    for joint in model.joints:
        mine = {p.name: p for p in model.parameters if p.joint == joint}
        rows.append(Row((joint, *(_brief(mine[k.name]) for k in used))))
    headings = (f"{k.name.replace('_', ' ')} {k.unit}".removesuffix(" 1") for k in used)
    return PlainTable("", "", ("joint", *headings), rows)


def _brief(one: ActuatorParameter) -> str:
    if one.interval is None:
        return significant(one.value) if one.status == "stated" else NONE
    if one.status == "not identifiable":
        return f"{significant(one.value, 2)} ?"
    half = 0.5 * (one.interval[1] - one.interval[0]) / one.value
    return f"{significant(one.value)} ±{100.0 * half:.0f}%"


RATIOS = (
    ("coulomb", "dry friction over stiffness [mrad]"),
    ("damping", "damping over stiffness [ms]"),
    ("armature", "armature over stiffness [10⁻³ s²]"),
)


def ratios_table(model: ActuatorModel) -> PlainTable:
    """What positions alone determine: parameters over the stiffness."""
    rows = []
    for j, joint in enumerate(model.joints):
        cells = []
        for name, _ in RATIOS:
            found = model.ratio(name, j)
            if found is None:
                cells.append(NONE)
                continue
            value, std = found
            low, high = value * np.exp(-Z95 * std), value * np.exp(Z95 * std)
            cells.append(f"{_milli(value)} [{_milli(low)}, {_milli(high)}]")
        rows.append(Row((joint, *cells)))
    words = "These need no masses; 95 % intervals in brackets."
    return PlainTable("", words, ("joint", *(heading for _, heading in RATIOS)), rows)


def law_words(law: Sequence[Rung]) -> str:
    """What the law has, and what was tried in vain."""
    kept = [r.tried for r in law if r.kept and r.tried[:1] in "+-"]
    other = [r.tried for r in law if not r.kept]
    words = "position_pd with " + ", ".join(p.replace("_", " ") for p in law_parts(law))
    if not kept and not other:
        return f"{words}, as stated"
    return f"{words}; tried on left-out motion and not kept: {', '.join(other) or 'none'}"


def law_parts(law: Sequence[Rung]) -> tuple[str, ...]:
    """Parameters of the law that was chosen."""
    return next(r.parts for r in reversed(law) if r.kept)


def law_table(law: Sequence[Rung]) -> PlainTable:
    """Laws that were tried."""
    rows = [
        Row((r.tried.replace("_", " "), _milli(r.error), "kept" if r.kept else "not kept"))
        for r in law
    ]
    words = "Each is fitted without a quarter of the motion, and judged by it."
    headings = ("tried", "error of left-out motion [mrad; mm]", "")
    return PlainTable("", words, headings, rows, (0, 2))


def _error_sections(result: ActuatorResult, shown: Sequence[OpenLoop]) -> Iterator[Any]:
    verdict = result.verdict
    label = "" if verdict.level == "none" else f"{verdict.level.upper()}: "
    tables = [errors_table(result.model, shown)]
    tables += [logs_table(result.model, shown)] if len(shown) > 1 else []
    yield figures("errors", "Open loop", words=f"{label}{verdict.line}. {_claim()}", tables=tables)
    yield notes("limits", "Limits of this result", result.warnings)


def _motion_section(model: ActuatorModel, shown: Sequence[OpenLoop]) -> Any:
    if not shown:
        return None
    return figures(
        "motion",
        "Measured and predicted motion",
        legend=[
            Key("--measured", "measured"),
            Key("--predicted", "predicted from targets"),
            Key("--interval", "target"),
        ],
        groups=[
            Group([_figure(model, one, j) for j in range(model.robot.n)], one.log, "", "one")
            for one in shown[:6]
        ],
        note="Errors of each joint are in the table above."
        + (f" The first 6 of {len(shown)} logs." if len(shown) > 6 else ""),
    )


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
