"""Logs that do not count, and why: unreadable, at rest, doubled, unlike the others."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import by_key
from steelyard.estimate.changes_from_model import LocalParameters, NormalEquations
from steelyard.estimate.information.part_information import PartSummary
from steelyard.logs.log_parts import LogPart

MISFIT = 25.0  # squared residual over the fleet's median from which on a log is left out
OTHER_UNIT = 3.0  # factor of most joints' efforts from which on their unit is another
ALIKE = 0.8  # correlation of measured and predicted efforts that differ by a factor
ABSOLUTE = 1e6  # times above are those of a clock that goes on between logs [s]


@dataclass(frozen=True)
class LeftOut:
    """A log, or a part of one, that does not count."""

    robot: str
    day: str
    log: str
    wrong: str
    fix: str
    at_rest: bool = False


def logs_left_out(
    parts: Sequence[LogPart],
    digests: Sequence[str],
    summaries: Sequence[PartSummary],
    equations: Sequence[NormalEquations | None],
    local: LocalParameters,
) -> dict[int, LeftOut]:
    """Parts that do not count, by number, and why."""
    out: dict[int, LeftOut] = {}

    def leave(number: int, wrong: str, fix: str, at_rest: bool = False) -> None:
        part = parts[number]
        out.setdefault(number, LeftOut(part.robot, part.day, part.where, wrong, fix, at_rest))

    for number, summary in enumerate(summaries):
        if summary.wrong:
            leave(number, summary.wrong, summary.fix, summary.at_rest)

    def leave_doubled(what: str, keys: Iterable[tuple[object, int]]) -> None:
        for first, *others in by_key(keys).values():
            for number in others:
                wrong = f"it has the same {what} as {parts[first].where}"
                leave(number, wrong, "name every log once")

    leave_doubled("bytes", (((d, parts[k].rows), k) for k, d in enumerate(digests)))
    motions = ((*(f"{speed:.9g}" for speed in summary.fastest),) for summary in summaries)
    left = [(k, m) for k, m in enumerate(motions) if k not in out]
    leave_doubled("motion", (((parts[k].robot, summaries[k].samples, m), k) for k, m in left))
    for number, before in _overlaps(parts, summaries):
        wrong = f"its clock overlaps that of {parts[before].where}"
        leave(number, wrong, "name logs of one robot that do not overlap, or other robots")
    usable = {k: e for k, e in enumerate(equations) if e is not None and k not in out}
    rests = {k: local.unexplained(e) for k, e in usable.items()}
    usual = float(np.median(list(rests.values()))) if rests else 0.0
    for number, one in usable.items():
        moved = one.predicted > 0.0
        factor = float(np.median(one.product[moved] / one.predicted[moved])) if moved.any() else 1.0
        sizes = np.sqrt(one.predicted * one.effort)[moved]
        alike = float(np.median(np.abs(one.product[moved]) / sizes)) if moved.any() else 0.0
        turned = one.product[moved] < 0.0
        if alike > ALIKE and np.count_nonzero(turned) > 0.5 * np.count_nonzero(moved):
            wrong = "most efforts have the opposite sign of the model's"
            leave(number, wrong, "`steelyard check` names them, for a robot file of such logs")
        elif alike > ALIKE and not turned.any() and not 1.0 / OTHER_UNIT < factor < OTHER_UNIT:
            size = f"{factor:.0f}" if factor > 9.5 else f"{factor:.2g}"
            wrong = f"efforts are about {size} times those of the model: another unit or gear side"
            leave(number, wrong, "give such logs a robot file of their own, with their unit")
        elif rests[number] > MISFIT * usual:
            times = np.sqrt(rests[number] / max(usual, 1e-300))
            wrong = f"the model does not explain it (residuals {times:.0f} times those of the "
            wrong += "others): another robot, or positions in another unit or order"
            leave(number, wrong, "`steelyard check` names what differs; or leave the robot out")
    return dict(sorted(out.items()))


def _overlaps(parts: Sequence[LogPart], summaries: Sequence[PartSummary]) -> list[tuple[int, int]]:
    """Parts of other files of the same robot at the same time, each with the one before it."""
    clocks = [k for k, s in enumerate(summaries) if not s.wrong and s.start > ABSOLUTE]
    pairs = []
    for mine in by_key((parts[k].robot, k) for k in clocks).values():
        mine.sort(key=lambda k: summaries[k].start)
        last = mine[0]
        for k in mine[1:]:
            other = parts[k].file != parts[last].file
            if other and summaries[k].start < summaries[last].stop:
                pairs.append((k, last))
            elif summaries[k].stop > summaries[last].stop:
                last = k
    return pairs
