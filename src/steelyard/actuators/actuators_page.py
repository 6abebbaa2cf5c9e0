"""What was found of actuators: their page, their text for the terminal and their JSON values."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from rich.console import Console
from rich.text import Text

from steelyard.actuators.actuator_model import CANNOT_BE, ActuatorModel, ActuatorParameter
from steelyard.actuators.actuator_parameters import KINDS
from steelyard.actuators.choice import LEAST_GAIN, LEAST_LOSS, Rung
from steelyard.actuators.open_loop import AFTER, OpenLoop, tool_body
from steelyard.base.arrays import Z95, Array
from steelyard.report.page import figures, inspected_page, notes
from steelyard.report.page_figures import Figure, Group, Key, drawn, line
from steelyard.report.result import Result, print_verdict
from steelyard.report.tables import PlainTable, Row, narrow_table
from steelyard.report.words import NONE, Level, count, first_names, significant

GOOD, FAIR = 0.35, 0.8
"""Mean error over that of "position = target", up to which a model is good, or fair."""
WORST_GOOD, WORST_FAIR = 0.7, 1.2
"""The same of the worst joint."""
RARE = 6.0  # error of a whole log over the usual residual, above which long stretches are missed
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
        every = (*self.fitted, *self.validation)
        return (
            *limit_words(self.model, every),
            *missed_words(self.model, every),
            *(note for note in self.notes if "no motion in these logs" in note),
            scale_words(self.model),
            *assumed_words(self.model),
            *unknown_words(self.model),
            *open_signs,
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
        _print(console, self, self.validation or self.fitted)
        table = parameters_table(self.model) if verbose else brief_table(self.model)
        console.print(narrow_table(table))
        for words in law_lines(self.model, self.law):
            console.print(Text(words), soft_wrap=True)
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
                *_error_sections(self, shown, shown),
                figures("parameters", "Parameters", tables=[parameters_table(self.model)]),
                figures("ratios", "Ratios to the stiffness", tables=[ratios_table(self.model)]),
                figures(
                    "law",
                    "The law",
                    words=" ".join(f"{one}." for one in law_lines(self.model, self.law)),
                    tables=[law_table(self.law)],
                ),
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
        """Logs that were fitted."""
        again = (f"{name} was fitted: it does not validate the model" for name in self.fitted)
        found = (limit_words, missed_words)
        return (*(x for of in found for x in of(self.model, self.validation)), *again)

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
        return inspected_page(
            f"{self.model.robot.name}: actuators, validation",
            self.model.robot.name,
            (
                *_error_sections(self, self.fresh or self.validation, self.validation, self.fitted),
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


def together(found: Sequence[OpenLoop], name: str = "rms") -> Array:
    """Root mean square over logs of an error by joint, by their lengths, `(n,)`."""
    weight = np.array([one.seconds for one in found])
    squares = np.array([getattr(one, name) ** 2 for one in found])
    return np.asarray(np.sqrt(weight @ squares / weight.sum()))


def limit_words(model: ActuatorModel, logs: Sequence[OpenLoop]) -> tuple[str, ...]:
    """Joints whose motion leaves the limits of the model file: their sign or zero is wrong."""
    q = np.concatenate([one.q for one in logs])
    return tuple(
        f"{CANNOT_BE}: with them {joint} moves over {words}; state position_sign and "
        "position_offset"
        for joint, words in model.outside_limits(q).items()
    )


def missed_words(model: ActuatorModel, logs: Sequence[OpenLoop]) -> tuple[str, ...]:
    """Joints whose error in some log is far above what is usual: something is not described."""
    by: dict[str, list[str]] = {}
    for one in logs:
        bad = (one.rms > RARE * model.scale) & (one.rms > 0.2 * one.target_rms)
        for j in np.flatnonzero(bad & (one.target_rms > STILL)):
            by.setdefault(model.joints[j], []).append(one.log)
    if not by:
        return ()
    listed = "; ".join(f"{joint} in {first_names(names, 3)}" for joint, names in by.items())
    return (
        "stretches that the model does not describe, such as contact, a stop, a torque limit, or a "
        f"servo that is off: {listed}",
    )


def assumed_words(model: ActuatorModel) -> tuple[str, ...]:
    """Joints without a scale of their own."""
    some = [p.joint for p in model.parameters if (p.name, p.status) == ("stiffness", "assumed")]
    if not some:
        return ()
    return (
        f"gravity hardly loads {', '.join(some)}: the stiffness is assumed to be the median of the "
        "others', and gives the other values of these joints their scale; state it if it is known",
    )


def verdict_of(model: ActuatorModel, found: Sequence[OpenLoop], where: str) -> ActuatorVerdict:
    """Errors of all joints against those of "position = target"."""
    rms, target = together(found), together(found, "target_rms")
    moves = target > STILL
    share = float(np.mean(rms[moves] / target[moves])) if moves.any() else None
    level: Level = "none"
    if share is not None:
        most = float(np.max(rms[moves] / target[moves]))
        good, fair = share <= GOOD and most <= WORST_GOOD, share <= FAIR and most <= WORST_FAIR
        level = "good" if good else "fair" if fair else "poor"
        if limit_words(model, found):
            level = "poor"
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


def _print(console: Console, found: ActuatorResult, shown: Sequence[OpenLoop]) -> None:
    verdict, name = found.verdict, found.model.robot.name
    console.print(Text(f"{name}: actuators"), style="dim")
    label = "" if verdict.level == "none" else f"{verdict.level.upper()}  "
    print_verdict(console, label + verdict.line, _claim(), found.warnings)
    console.print(narrow_table(errors_table(found.model, shown)))


def _claim() -> str:
    return (
        "Positions are predicted from the targets alone, from the first row on: root mean squares. "
        "Drift: the error some time after a start from a measured state, over many such starts."
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
    return PlainTable("", words, (*headings, *(f"drift {x:g} s" for x in AFTER)), rows)


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


def logs_table(
    model: ActuatorModel, found: Sequence[OpenLoop], fitted: Sequence[str] = ()
) -> PlainTable:
    """Errors of each log, joint by joint."""
    rows = [
        Row(
            (
                one.log + " (fitted)" * (one.log in fitted),
                *(_milli(x) for x in one.rms),
                _milli(one.tool),
            )
        )
        for one in found
    ]
    words = "Errors in mrad (mm of sliding joints)."
    return PlainTable("By log", words, ("log", *model.joints, "tool [mm]"), rows)


def fitted_table(fitted: Sequence[OpenLoop]) -> PlainTable:
    """The logs that the parameters are from."""
    rows = [Row((one.log, significant(one.seconds))) for one in fitted]
    return PlainTable("", "", ("log", "length [s]"), rows)


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
        told = one.status in ("stated", "assumed")
        return f"{significant(one.value)} ({one.status})" if told else NONE
    low, high = one.interval
    mark = " ?" if one.status == "not identifiable" else ""
    return f"{significant(one.value)} [{significant(low, 2)}, {significant(high, 2)}]{mark}"


def brief_table(model: ActuatorModel) -> PlainTable:
    """The parameters of the law in few columns, for the terminal: `?` for wide intervals."""
    used = [
        k
        for k in KINDS
        if k.positive
        and any(p.name == k.name and p.status != "not in the law" for p in model.parameters)
    ]
    rows = []
    for joint in model.joints:
        mine = {p.name: p for p in model.parameters if p.joint == joint}
        rows.append(Row((joint, *(_brief(mine[k.name]) for k in used))))
    headings = (f"{k.name.replace('_', ' ')} {k.unit}".removesuffix(" 1") for k in used)
    return PlainTable("", "", ("joint", *headings), rows)


def _brief(one: ActuatorParameter) -> str:
    if one.interval is None:
        if one.status == "assumed":
            return f"{significant(one.value)} assumed"
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


def law_lines(model: ActuatorModel, law: Sequence[Rung]) -> list[str]:
    """What the law has, what of the usual one it does without, and what was tried in vain."""
    parts = [p for p in law_parts(law) if p not in ("stiffness", "damping", "offset", "zero")]
    lines = [f"law    position controller with {', '.join(_words(p) for p in parts)}"]
    delay = next(p for p in model.parameters if p.name == "delay")
    if delay.interval is not None:
        low, high = (1e3 * x for x in delay.interval)
        size = f"{significant(1e3 * delay.value)} [{significant(low, 2)}, {significant(high, 2)}]"
        lines.append(f"delay  {size} ms, of all joints")
    elif delay.status == "stated":
        lines.append(f"delay  {significant(1e3 * delay.value)} ms, as stated")
    else:
        lines.append("delay  none: motion that was left out is predicted as well without one")
    tried = [_words(r.tried[2:]) for r in law if r.tried.startswith("+") and not r.kept]
    if tried:
        lines.append(f"tried on left-out motion, and not needed: {', '.join(tried)}")
    return lines


def _words(part: str) -> str:
    """A part of the law in words."""
    return {
        "coulomb": "dry friction",
        "armature": "rotor inertia",
        "load_friction": "friction that grows with the load",
        "torque_limit": "a torque limit",
        "dead_band": "a dead band",
    }.get(part, part.replace("_", " "))


def law_parts(law: Sequence[Rung]) -> tuple[str, ...]:
    """Parameters of the law that was chosen."""
    return next(r.parts for r in reversed(law) if r.kept)


def law_table(law: Sequence[Rung]) -> PlainTable:
    """Laws that were tried."""
    rows = []
    for r in law:
        sign, part = r.tried[:1], _words(r.tried[2:])
        name = f"with {part}" if sign == "+" else f"without {part}" if sign == "-" else r.tried
        rows.append(Row((name, _milli(r.error), "taken" if r.kept else "not taken")))
    words = (
        "Each is fitted without a quarter of the motion, and judged by the residuals of that "
        "quarter: geometric mean of their usual and their root mean square size. A part is "
        f"added if it takes away {LEAST_GAIN:.0%} of it, and left out if the error grows by less "
        f"than {LEAST_LOSS:.1%} without it."
    )
    return PlainTable("", words, ("law", "left-out error [mrad]", ""), rows, (0, 2))


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
    yield figures("errors", "Open loop", words=f"{label}{verdict.line}. {_claim()}", tables=tables)
    yield notes("limits", "Limits of this result", result.warnings)


SHOWN_LOGS = 6  # whose motion the page shows


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
