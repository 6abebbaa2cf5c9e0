"""Sections of the report on a reduced model: its path, and what was removed."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.reduction.backward_elimination_and_left_out_errors import CRITERIA
from steelyard.estimate.reduction.stopping_rules_and_reduction import Reduction
from steelyard.estimate.scores.effort_errors import pooled
from steelyard.identify.page.report_content_and_error_words import MOVING, WHOLE, ReportContent
from steelyard.model.laws.register import law_of
from steelyard.model.terms.term import StatefulTerm
from steelyard.report.page import FigureSection, Numbers, TableSection
from steelyard.report.page_figures import Figure, Group, Key, area, line, points
from steelyard.report.tables import PlainTable, Row, table_of, text_table
from steelyard.report.words import NONE, count, rounded_to_uncertainty, significant

HOLDS_ONLY = (
    "The reduced model describes motions like those of the fitted logs only: speeds and positions "
    "up to those in the table. Elsewhere, or with a payload, a removed parameter may matter."
)


class ReductionSection(FigureSection, name="reduction", title="Reduction"):
    """Error and condition number by the number of parameters."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Curves."""
        found = content.reduction
        if found is None:
            return None
        keys = [Key("--residual", "fitted")]
        if found.left_out is not None:
            keys.append(Key("--predicted", "left out, chosen in the others"))
            keys.append(Key("--surely", "its standard error to the best", "area"))
        if found.unseen is not None:
            keys.append(Key("--measured", "unseen motion"))
        return {
            "words": _summary(content, found),
            "legend": keys,
            "groups": [Group([_errors(found), _conditions(found)])],
            "note": f"Errors are {measure_of(found)}; that of the headline is pooled over joints "
            "in a fixed band. Left-out data are predicted by models that were made without them. "
            "The standard error is that of the difference to the best number of parameters. "
            + HOLDS_ONLY,
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """What was kept, and the errors along the path."""
        found = content.reduction
        if found is None:
            return {}
        left, unseen = _by_size(found), [None] * len(found.path.states)
        if found.unseen is not None:
            unseen = found.unseen.mean(axis=1).tolist()
        return {
            "kept": list(found.estimate.parameters.names),
            "criterion": {
                "name": found.criterion.name,
                "about": found.criterion.about,
                "parameters": found.worth(),
            },
            "joint_errors": {"measure": found.rule.measure, "joints": found.joint_errors()},
            "parameter_comparison": parameter_comparison(content.identified),
            "models": [
                {
                    "parameters": len(state.active),
                    "condition": state.condition,
                    "left_out_percent": left.get(len(state.active)),
                    "unseen_percent": error,
                }
                for state, error in zip(found.path.states, unseen, strict=True)
            ],
        }

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The choice in a few lines, errors and values of both models, the criterion if named."""
        found = content.reduction
        if found is not None:
            yield Text(_summary(content, found))
            yield text_table(_joints(found), self.title)
            yield text_table(_compared(content.identified), self.title)
            if found.criterion != CRITERIA[0]:
                yield text_table(_worth(found), self.title)


class RemovalsSection(TableSection, name="removals", title="Removed parameters"):
    """What was removed, and the motions that it was removed for."""

    def tables(self, content: ReportContent) -> Sequence[PlainTable]:
        """The five tables; none without a reduction."""
        found, identified = content.reduction, content.identified
        if found is None:
            return ()
        both = _joints(found), _compared(identified)
        return (*both, _removals(found), _worth(found), _ranges(identified))


def _summary(content: ReportContent, found: Reduction) -> str:
    full, first, state = found.path.full, found.path.states[0], found.state
    size, most = len(state.active), len(first.active)
    removed = len(full.names) - size
    earlier = len(found.estimate.removed) - removed
    sentences = [
        f"{size} of {count(len(full.names), 'parameter')} kept, {removed} removed"
        + (f" ({earlier} more before)" if earlier > 0 else "")
        + f": condition number {significant(first.condition)} to {significant(state.condition)}."
    ]
    before, after = (pooled(x.errors for x in some) for some in (content.before, content.scores))
    if before and after:
        shares = ([_fine_print(one.percent_of_used) for one in some] for some in (before, after))
        changes = (f"{old} to {new} of the effort used" for old, new in zip(*shares, strict=True))
        sentences.append(f"Error on unseen motion, as in the first line: {'; '.join(changes)}.")
    parts, left = [], _by_size(found)
    if size in left and most in left:
        parts.append(f"left-out data {_fine_print(left[most])} to {_fine_print(left[size])}")
    if found.unseen is not None:
        start, end = (_fine_print(float(found.unseen[k].mean())) for k in (0, found.chosen))
        parts.append(f"unseen motion {start} to {end}")
    if parts:
        measure = measure_of(found)
        sentences.append(f"The choice is by another measure, {measure}: {', '.join(parts)}.")
    sentences.append(_joints_judged(found))
    return " ".join(sentences)


def _joints_judged(found: Reduction) -> str:
    """Joints whose errors the removals raise by more than the tolerance, and on what motion."""
    names, size = found.path.full.information.layout.rows, len(found.state.active)
    rises = {}
    if found.left_out is not None and size in found.left_out.sizes:
        motion = f"left-out motion ({', '.join(found.left_out.folds)} in turn)"
        rises[motion] = found.left_out.joint_rise[found.left_out.sizes.index(size)]
    if found.unseen is not None:
        first, last = np.maximum(found.unseen[[0, found.chosen]], 1e-9)
        rises["unseen motion"] = last / first - 1.0
    first, last = np.maximum(found.fitted[:2], 1e-300)
    rises["fitted motion" + ", as none is left out" * (not rises)] = last / first - 1.0
    sentences = []
    for motion, rise in rises.items():
        order = [k for k in np.argsort(-rise) if rise[k] > found.rule.tolerance]
        worse = [f"{names[k]} {significant(100.0 * rise[k])} %" for k in order]
        allowed = f"more than {100.0 * found.rule.tolerance:g} %"
        which = f"the error of no joint rises by {allowed}"
        if worse:
            which = f"the error rises by {allowed}: {', '.join(worse)}"
        sentences.append(f"on {motion} {which}")
    return f"By joint: {'; '.join(sentences)}."


def measure_of(found: Reduction) -> str:
    """The relative error that models of a path are compared by."""
    laws = (law_of(name) for name in found.path.full.names)
    # all samples of a log count if a law of the model knows friction at rest
    samples = WHOLE if any(issubclass(law, StatefulTerm) for law in laws) else MOVING
    return f"the mean of the joints' relative errors in the validation band, {samples}"


def _fine_print(value: float) -> str:
    """A percentage with three digits: models of a path differ by little."""
    return f"{significant(value)} %"


def _by_size(found: Reduction) -> dict[int, float]:
    """Mean error on left-out data by the number of parameters [%]."""
    if found.left_out is None:
        return {}
    return dict(zip(found.left_out.sizes, found.left_out.mean.tolist(), strict=True))


def _errors(found: Reduction) -> Figure:
    sizes = np.array(found.path.sizes, dtype=np.float64)
    efforts = np.sqrt(np.maximum(found.path.full.information.effort_squares(), 1e-300))
    fitted = np.array([100.0 * np.sqrt(s.squares) / efforts for s in found.path.states])
    traces = [line("fitted", sizes, fitted.mean(axis=1), "--residual", dash="dot")]
    if found.left_out is not None:
        left, at = found.left_out, np.array(found.left_out.sizes, dtype=np.float64)
        half = left.mean * left.spread
        traces.append(area("standard error", at, left.mean - half, left.mean + half, "--surely"))
        traces.append(line("left out", at, left.mean, "--predicted", dash="5px,2px"))
    if found.unseen is not None:
        traces.append(line("unseen", sizes, found.unseen.mean(axis=1), "--measured"))
    chosen = np.array([sizes[found.chosen]])
    traces.append(points("chosen", chosen, fitted[[found.chosen]].mean(axis=1), "--residual", 9))
    most = 3.0 * float(fitted[0].mean()) if fitted[0].mean() > 0.0 else None
    layout = {"showlegend": False, "yaxis": {"range": [0.0, most]} if most else {}}
    label = "Error of fitted, left-out and unseen data by the number of parameters"
    title, caption = "Error by the number of parameters", f"chosen: {int(chosen[0])}"
    return Figure(title, label, "parameters", "error [%]", traces, layout, caption)


def _conditions(found: Reduction) -> Figure:
    sizes = np.array(found.path.sizes, dtype=np.float64)
    values = np.array([state.condition for state in found.path.states])
    chosen = [found.chosen]
    traces = [
        line("condition number", sizes, values, "--measured"),
        points("chosen", sizes[chosen], values[chosen], "--measured", 9),
    ]
    label, layout = "Condition number by the number of parameters", {"showlegend": False}
    return Figure("Condition number", label, "parameters", "condition number", traces, layout)


MEASURES = {"rms": "root mean square", "mean_absolute": "mean absolute"}
"""Measures of errors in words."""


def _joints(found: Reduction) -> PlainTable:
    measure = MEASURES[found.rule.measure]
    words = (
        f"{measure.capitalize()} errors of the fitted motion, in the joint's unit and relative to "
        f"the {measure} effort; both models by {found.path.full.method}."
    )
    return table_of(
        found.joint_errors(),
        {
            "Joint": lambda row: row["joint"],
            "Full": lambda row: significant(row["full"]),
            "Reduced": lambda row: significant(row["reduced"]),
            "Unit": lambda row: row["unit"],
            "Full [%]": lambda row: significant(row["full_percent"]),
            "Reduced [%]": lambda row: significant(row["reduced_percent"]),
        },
        caption="Errors of the full and the reduced model",
        words=words,
        text=(0, 3),
        note=words,
    )


def parameter_comparison(reduced: IdentifiedModel) -> list[dict[str, Any]]:
    """Parameters of the full model beside those of the reduced one, a row each.

    Each row has `name`, `unit`, the value, its standard deviation and the latter in percent of the
    value ([Volkmann], eq. 14) of the full model by weighted least squares, `full`, `full_std` and
    `full_relative_std_percent`, and the same of the `reduced` one; `None` where there is no value.
    """
    (full,) = reduced.reference
    models = {"full": full, "reduced": reduced.estimate}
    names = dict.fromkeys(name for one in models.values() for name in one.parameters.names)
    units: dict[str, str] = {}
    for one in models.values():
        units |= dict(zip(one.parameters.names, one.parameters.units, strict=True))
    rows: list[dict[str, Any]] = [{"name": name, "unit": units[name]} for name in names]
    for label, one in models.items():
        figures = zip(one.parameters.values.tolist(), one.std.tolist(), strict=True)
        known = dict(zip(one.parameters.names, figures, strict=True))
        for row in rows:
            value, std = known.get(row["name"], (None, None))
            row |= {label: value, f"{label}_std": std, f"{label}_relative_std_percent": None}
            if value and std is not None:
                row[f"{label}_relative_std_percent"] = 100.0 * std / abs(value)
    return rows


def _compared(reduced: IdentifiedModel) -> PlainTable:
    def value(row: dict[str, Any], label: str) -> str:
        std = row[f"{label}_std"]
        return NONE if row[label] is None else rounded_to_uncertainty(row[label], std)

    words = (
        "A dash: not identifiable in the full model, removed from the reduced one. Standard "
        "deviations count the residuals and their correlation, but not the choice of parameters."
    )
    return table_of(
        parameter_comparison(reduced),
        {
            "Parameter": lambda row: row["name"],
            "Unit": lambda row: row["unit"],
            "Full": lambda row: value(row, "full"),
            "Std": lambda row: significant(row["full_std"], 2),
            "Std [%]": lambda row: significant(row["full_relative_std_percent"], 2),
            "Reduced": lambda row: value(row, "reduced"),
            "Std of it": lambda row: significant(row["reduced_std"], 2),
            "In %": lambda row: significant(row["reduced_relative_std_percent"], 2),
        },
        caption="Parameters of the full and the reduced model",
        words=words,
        text=(0, 1),
        note=words,
    )


def _removals(found: Reduction) -> PlainTable:
    left = found.left_out
    size = len(found.state.active)
    folds: dict[str, str] = {}
    if left is not None and size in left.sizes:
        removed, mine = left.removed[left.sizes.index(size)], found.estimate.removed
        names = {one.name for one in mine} & {step.name for step in found.path.steps}
        folds = {name: f"{removed[name]} of {len(left.folds)}" for name in names}
    return table_of(
        found.estimate.removed,
        {
            "Step": lambda one: str(one.step),
            "Parameter": lambda one: one.name,
            "Cost": lambda one: significant(one.cost),
            "Folds": lambda one: folds.get(one.name, ""),
        },
        caption="In the order of their removal",
        words=" Cost: rise of χ² by the removal, counted with the correlation of residuals;"
        " a parameter that is zero in truth costs 1 on average. Folds: left-out parts of the data "
        "without which the same parameter was removed as well.",
        text=(1,),
    )


def _worth(found: Reduction) -> PlainTable:
    about = f"{found.criterion.heading}: {found.criterion.about}."
    words = f"{about} Last: before the removal, or in the model that was taken."
    return table_of(
        found.worth(),
        {
            "Parameter": lambda row: str(row["name"]),
            "Step": lambda row: "kept" if row["step"] is None else str(row["step"]),
            "Before any removal": lambda row: significant(row["before"]),
            "Last": lambda row: significant(row["last"]),
        },
        caption=f"{found.criterion.heading} by parameter",
        words=words,
        text=(0, 1),
        note=words,
    )


def _ranges(identified: IdentifiedModel) -> PlainTable:
    robot = identified.model.robot
    q = np.concatenate([samples.q for samples in identified.motions])
    speeds = [
        np.abs(np.diff(s.q, axis=0) / np.maximum(np.diff(s.t), 1e-9)[:, None]).max(axis=0)
        for s in identified.motions
        if len(s.t) > 1
    ]
    fastest = np.max(speeds, axis=0) if speeds else np.full(robot.n, np.nan)
    figures = zip(q.min(axis=0), q.max(axis=0), fastest, strict=True)
    each = zip(robot.coordinates, figures, strict=True)
    rows = [Row((joint.name, *map(significant, numbers), joint.unit)) for joint, numbers in each]
    headings = ("Joint", "Least position", "Greatest position", "Greatest mean speed", "Unit")
    return PlainTable("Range of the fitted motions", HOLDS_ONLY, headings, rows, (0, 4))
