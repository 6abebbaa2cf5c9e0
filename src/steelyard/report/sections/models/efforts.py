"""Measured effort and that of every model over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.figures import Figure, Group, Key, line
from steelyard.report.sections.models.colours import colour, dash, legend
from steelyard.report.sections.section import FigureSection, Numbers
from steelyard.report.text.words import percent
from steelyard.report.thin import drawn

if TYPE_CHECKING:
    from steelyard.validation.model_comparison import ModelComparison

POINTS = 1500
"""Most points of a line."""

FEWEST = 200
"""Points of a line below which rather a whole log is left out."""

BUDGET = 170_000
"""Points of all lines together."""

MEASURED = "--ink"


class ModelEffortsSection(FigureSection):
    """A picture per joint, the logs one after the other."""

    name: ClassVar[str] = "model-efforts"
    title: ClassVar[str] = "Efforts over time"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Efforts, if models were compared."""
        found = content.models
        if found is None:
            return None
        of_run = len(found.joints) * (len(found.models) + 1)
        runs = found.runs[: max(BUDGET // (of_run * FEWEST), 1)]
        most = max(min(POINTS, BUDGET // (of_run * len(runs))), FEWEST)
        left_out = found.runs[len(runs) :]
        cutoff = found.models[0].runs[0].errors.cutoff
        return {
            "words": f"Measured and predicted below {cutoff:g} Hz.",
            "groups": [
                Group([_figure(found, k, j, most) for j in range(len(found.joints))], name)
                for k, name in enumerate(runs)
            ],
            "legend": [
                Key(MEASURED, "measured"),
                *legend([model.name for model in found.models], "line"),
            ],
            "note": f"Not drawn: {', '.join(left_out)}." if left_out else "",
        }


def _figure(found: ModelComparison, run: int, joint: int, most: int) -> Figure:
    """Efforts of one joint in one log."""
    first = found.models[0].runs[run]
    origin = float(first.t[0]) if len(first.t) and abs(first.t[-1]) > 1e5 else 0.0
    own = first.errors.joints[joint]
    x, y = drawn(first.t - origin, first.measured[:, joint], most)
    traces = [line("measured", x, y, MEASURED, width=1.6)]
    shares = []
    for k, model in enumerate(found.models):
        errors = model.runs[run]
        x, y = drawn(errors.t - origin, errors.predicted[:, joint], most)
        traces.append(line(model.name, x, y, colour(k), width=1.2, dash=dash(k)))
        shares.append(f"{model.name} {percent(errors.errors.joints[joint].percent_of_used)}")
    label = f"Measured and predicted effort of {own.joint} in {first.run}"
    time = f"time from {origin:.3f} s [s]" if origin else "time [s]"
    y_title = f"effort [{own.unit}]"
    layout = {"showlegend": False}
    return Figure(own.joint, label, time, y_title, traces, layout, ", ".join(shares))
