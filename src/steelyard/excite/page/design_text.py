"""A designed motion in words, for its page and for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite, sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import by_key
from steelyard.excite.constraints.certificate import COVERS
from steelyard.excite.predicted_accuracy_and_advice import HELPFUL_SHARE
from steelyard.excite.trajectories.motion_families import FAMILIES
from steelyard.report.page import LabelledValues, PageContent
from steelyard.report.tables import light_table
from steelyard.report.words import COLOURS, NONE, Level, count, percent, relative, significant

if TYPE_CHECKING:
    from rich.console import Console

    from steelyard.excite.constraints.certificate import Proof
    from steelyard.excite.predicted_accuracy_and_advice import Advice
    from steelyard.excite.searched_or_planned_motion import Designed
    from steelyard.robot.file.excitation_sections import WorkspaceSection

KINDS = {
    "fourier": "Fourier series from rest to rest",
    "raw_fourier": "Fourier series",
    "blended_fourier": "Fourier series with blends from and to rest",
    "ramped_fourier": "Fourier series with amplitude ramps from and to rest",
    "spline": "B-splines from rest to rest",
    "reaching": "minimum-jerk moves between postures",
    "pick_and_place": "pick-and-place cycles",
    "square": "edges of a square",
    "waypoints": "moves from point to point",
    "circle": "circle of the tool",
    "cartesian_reaching": "straight minimum-jerk reaches of the tool",
    "sweeps": "one joint after another at several speeds",
    "postures": "static postures",
    "replay": "motion from a file",
}

MOST_LENGTH_IN_MILLIMETRES = 0.1  # lengths below this [m] are printed in millimetres
MOST_NAMED_PARAMETERS = 3  # most parameters that a line of advice names
LEAST_TIGHT_SHARE = 0.9  # share of a limit from which on it is tight
LEAST_HIDING_RATIO = 50.0  # std over what it were with all others known: above, others hide it
LEAST_MARGIN = 1e-6  # margins below this are none: motions are scaled until they reach a limit
USED_SHARE_HEADING = "Share of the limit used"  # heading of a column
MOST_EQUAL_DEVIATION = 0.02  # shares of deviations that differ by less are printed as one


@dataclass(frozen=True, kw_only=True)
class DesignContent(PageContent):
    """What the page shows, also where its tool may be, and the files that were written."""

    design: Designed
    workspace: WorkspaceSection | None = None
    files: LabelledValues = ()


@dataclass(frozen=True)
class Expected:
    """What a motion will show of one parameter, as far as its value is known.

    The predicted standard deviation, infinite if nothing shows it; the same over the value [%],
    `None` without one; its `spread`, over that with all other parameters known.
    """

    name: str
    unit: str
    std: float
    value: float | None
    relative_percent: float | None
    spread: float | None

    @property
    def rank(self) -> tuple[bool, float, float]:
        """Grows with how badly it will be known: first what is not shown, then by the value."""
        return (
            not isfinite(self.std),
            -1.0 if self.relative_percent is None else self.relative_percent,
            -1.0 if self.spread is None else self.spread,
        )


def expected(designed: Designed) -> tuple[Expected, ...]:
    """All base parameters, the worst shown first."""
    shown, std_of = designed.shown, designed.shown.std(designed.prior)
    alone, found = np.diagonal(designed.gram), []
    for name, unit, std, own in zip(shown.names, shown.units, std_of, alone, strict=True):
        value = designed.values.get(name)
        found.append(
            Expected(
                name,
                unit,
                float(std),
                None if value is None else float(value),
                100.0 * float(std) / abs(value) if value else None,
                float(std) * sqrt(own) if own > 0.0 and isfinite(std) else None,
            )
        )
    return tuple(sorted(found, key=lambda one: one.rank, reverse=True))


@dataclass(frozen=True)
class Near:
    """A limit and how near the motion comes to it.

    The `kind` is a quantity of the joints or a constraint, the `name` a joint or one of its
    margins. What is `left` is negative beyond the limit; the share `used` is 1 there.
    """

    kind: str
    name: str
    left: float
    unit: str
    used: float


def joint_limits(designed: Designed) -> list[Near]:
    """All limits of joints."""
    return [
        Near(one.quantity, one.joint, one.margin, one.unit, one.used)
        for one in designed.certificate.extremes
        if one.margin is not None and one.used is not None
    ]


def margins_of(proof: Proof) -> list[Near]:
    """The margins of a constraint."""
    margins = zip(proof.labels, proof.proven, proof.used, strict=True)
    return [Near(proof.name, label, left, proof.unit, share) for label, left, share in margins]


def rank(near: Near) -> float:
    """Sorts the most used limit to the front."""
    return -near.used


def nearest(designed: Designed) -> list[Near]:
    """Of every kind of limit the one that is used most, the most used first."""
    found: dict[str, Near] = {}
    proofs = designed.certificate.proofs
    every = [*joint_limits(designed), *(one for proof in proofs for one in margins_of(proof))]
    for one in sorted(every, key=rank):
        found.setdefault(one.kind, one)
    return list(found.values())


def tightest(designed: Designed) -> list[str]:
    """All limits of joints and of constraints that are nearly used up, the most used first."""
    close = [one for one in joint_limits(designed) if one.used >= LEAST_TIGHT_SHARE]
    assumed = designed.limits.assumed
    groups = by_key(((one.kind, (one.kind, one.name) in assumed), one) for one in close)
    lines = [
        (max(one.used for one in joints), _nearly(designed, *group, joints))
        for group, joints in groups.items()
    ]
    for proof in designed.certificate.proofs:
        near = sorted((one for one in margins_of(proof) if one.used >= LEAST_TIGHT_SHARE), key=rank)
        named = [f"{x.name}, {margin(x.left, x.unit)} left" for x in near[:MOST_NAMED_PARAMETERS]]
        if (more := len(near) - len(named)) > 0:
            named.append(f"{more} more")
        lines += [(near[0].used, f"{proof.name}: {'; '.join(named)}")] if named else []
    return [line for _, line in sorted(lines, key=lambda pair: -pair[0])]


def _nearly(designed: Designed, quantity: str, assumed: bool, joints: Sequence[Near]) -> str:
    """Joints that nearly use up their limits of one quantity, and where these come from."""
    shares = sorted(100.0 * one.used for one in joints)
    share = 1.0 if quantity == "position" else designed.limits.share
    origin = f"{100.0 * share:g} % of " if share < 1.0 else ""
    names = ", ".join(one.name for one in joints)
    ends = " to ".join(dict.fromkeys(f"{share:.1f}" for share in (shares[0], shares[-1])))
    if len(joints) == 1:
        given = "an assumed one" if assumed else "the given one" if origin else ""
        which = f", which is {origin}{given}" if given else ""
        return f"{quantity} of {names}: {ends} % of its limit used{which}"
    given = "assumed ones" if assumed else "the given ones" if origin else ""
    which = f", which are {origin}{given}" if given else ""
    return f"{quantity} of {len(joints)} joints: {ends} % of their limits used{which}: {names}"


def used_words(near: Near) -> str:
    """Share of a limit that is used, like `93 %`; of a distance beyond its scale, none."""
    return NONE if not isfinite(near.used) else percent(100.0 * max(near.used, 0.0))


def left_words(near: Near) -> str:
    """What is left to a limit, with its unit."""
    return "at the limit" if abs(near.left) < LEAST_MARGIN else margin(near.left, near.unit)


def margin(value: float, unit: str) -> str:
    """A margin with its unit, small lengths in millimetres."""
    if value == -inf:
        return "no bound"
    if unit == "m" and abs(value) < MOST_LENGTH_IN_MILLIMETRES:
        return f"{significant(1e3 * value)} mm"
    return f"{significant(value)} {unit}"


def capitalised(words: str) -> str:
    """Words with a capital at the start."""
    return words[:1].upper() + words[1:]


def design_level(designed: Designed) -> Level:
    """Good if all is proven, looked at and shown well; fair if something is not."""
    if not designed.certificate.holds:
        return "poor"
    blurred = designed.kind in FAMILIES and hidden(designed)[list(designed.chosen_parameters)].any()
    return "fair" if designed.certificate.gaps or unended(designed) or blurred else "good"


def hidden(designed: Designed) -> NDArray[np.bool_]:
    """Which parameters others hide, by more than `LEAST_HIDING_RATIO`, or wholly; shape `(b,)`."""
    alone = 1.0 / np.sqrt(np.maximum(np.diagonal(designed.gram), 1e-300))
    std = designed.shown.std(designed.prior)
    return np.asarray(np.isinf(std) | (std > LEAST_HIDING_RATIO * alone))


def unended(designed: Designed) -> bool:
    """Whether a motion that is searched comes from no search that came to its end."""
    return designed.kind in FAMILIES and designed.searches == 0


def design_headline(designed: Designed) -> str:
    """What the motion shows, and whether it is safe, in a line."""
    missing, every = unseen(designed), len(designed.shown.names) + designed.faint
    known = every - missing - designed.faint
    which = f"all {every}" if known == every else f"{known} of {every}"
    shows = f"The motion makes {which} base parameters identifiable"
    if designed.absent:
        shows += f" of a model reduced by {len(designed.absent)}"
    if hardly := int(hidden(designed).sum()) - missing:
        shows += f", {hardly} of them poorly"
    if unended(designed):
        shows += ", but no search converged"
    certificate = designed.certificate
    if certificate.failures:
        return f"{shows}; not safe: {count(len(certificate.failures), 'limit')} not proven"
    limits = "every checked limit" if designed.certificate.uncovered else "every limit"
    return f"{shows}; {limits} is proven to hold at all times"


def scopes(designed: Designed) -> str:
    """What of the robot each constraint is about, such as `tool box (tool point only)`."""
    proofs = designed.certificate.proofs
    return "; ".join(f"{proof.name} ({proof.scope})" for proof in proofs if proof.scope)


def figure_of(designed: Designed) -> str:
    """The criterion that was asked for."""
    value = designed.shown.criterion_value
    return significant(value) if isfinite(value) else "infinite"


def design_detail(designed: Designed) -> str:
    """Which motion it is and how it was found."""
    kind = KINDS.get(designed.kind, designed.kind)
    words = f"{designed.trajectory.duration:.4g} s, {kind}; {designed.criterion} "
    words += f"{figure_of(designed)} (smaller is better)"
    if unended(designed):
        words += f", from an unfinished search of {seconds_text(designed.seconds)}"
    elif designed.course:
        words += f", best of {searches(designed)} in {seconds_text(designed.seconds)}"
    if designed.stopped:
        words += ", stopped early"
    return words


def seconds_text(seconds: float) -> str:
    """A time to three figures, like `2.5 s`; a long one to the second, like `3600 s`."""
    return f"{seconds:.3g} s" if seconds < 999.5 else f"{seconds:.0f} s"


def searches(designed: Designed) -> str:
    """Like `1 search`, `12 searches`."""
    return "1 search" if designed.searches == 1 else f"{designed.searches} searches"


def unseen(designed: Designed) -> int:
    """How many parameters nothing will show."""
    return int(np.sum(~np.isfinite(designed.shown.std(designed.prior))))


def brings(designed: Designed, one: Advice, most: int = MOST_NAMED_PARAMETERS) -> str:
    """What a further motion would bring, such as `viscous.j3 from 0.12 to 0.05 Nm s/rad`."""
    if not one.helps:
        return f"no std below {100.0 * HELPFUL_SHARE:.0f} %"
    shares = [share for _, share in one.helps]
    if (
        len(shares) == len(designed.shown.names)
        and max(shares) - min(shares) < MOST_EQUAL_DEVIATION
    ):
        return f"all parameters to {100.0 * shares[0]:.0f} %"
    named = "; ".join(_fall(designed, one, name) for name, _ in one.helps[:most])
    more = len(one.helps) - most
    return named + (f", and {more} more" if more > 0 else "")


def _fall(designed: Designed, one: Advice, name: str) -> str:
    k = designed.shown.names.index(name)
    before, to = float(designed.shown.std(designed.prior)[k]), significant(float(one.std[k]), 2)
    unit = designed.shown.units[k]
    if not isfinite(before):
        return f"{name} to {to} {unit}, not identifiable before"
    return f"{name} from {significant(before, 2)} to {to} {unit}"


def instead(designed: Designed, one: Advice) -> str:
    """What as many seconds of the designed motion itself would bring."""
    if designed.prior is not None or one.seconds <= 0.0:
        return NONE
    length = designed.trajectory.duration
    return f"{100.0 * sqrt(length / (length + one.seconds)):.0f} %"


def helpful(advice: Sequence[Advice]) -> list[Advice]:
    """Advice in the order of how many parameters it helps."""
    return sorted(advice, key=lambda one: -len(one.helps))


MOST_NAMED_WORST = 5  # parameters that are named
MOST_ADVICE_LINES = 3  # most lines of advice, each of which names one parameter
MOST_UNPROVEN_LINES = 5  # most lines about what is not proven


def print_design(designed: Designed, console: Console, verbose: bool = False) -> None:
    """Print the verdict, what is not covered, the tightest limit, the least accurate parameters.

    With `verbose` also scopes, all tight limits, all advice and the notes.
    """
    from rich.text import Text

    shown, tight = designed.shown, tightest(designed)
    console.print(Text(design_headline(designed), style=f"bold {COLOURS[design_level(designed)]}"))
    console.print(Text(design_detail(designed)))
    figures = f"condition {significant(shown.raw)}, normalised {significant(shown.normalised)}"
    console.print(Text(f"{figures}, {count(len(shown.names), 'base parameter')}"))
    failures = designed.certificate.failures
    for line in failures[:MOST_UNPROVEN_LINES]:
        console.print(Text(f"not proven: {line}", style="red"))
    if len(failures) > MOST_UNPROVEN_LINES:
        console.print(Text(f"not proven: {len(failures) - MOST_UNPROVEN_LINES} more", style="red"))
    console.print(Text(f"covered: {COVERS}"))
    for line in designed.certificate.uncovered:
        console.print(Text(f"not covered: {line}", style="yellow"))
    for line in tight if verbose else tight[:1]:
        console.print(Text(f"smallest margins: {line}"))
    console.print()
    console.print(Text("least accurate parameters"))
    rows = expected(designed)[:MOST_NAMED_WORST]
    valued = any(one.relative_percent is not None for one in rows)
    of_value = ("of value",) if valued else ()
    table = light_table(("parameter", "std", "unit", *of_value, "inflation"), (0, 2))
    for one in rows:
        std = significant(one.std, 2) if isfinite(one.std) else "not identifiable"
        share = [relative(one.relative_percent)] if valued else []
        # how much of a deviation is owed to the other parameters
        spread = NONE if one.spread is None else f"{significant(one.spread, 2)} ×"
        table.add_row(Text(one.name), std, Text(one.unit), *share, spread)
    console.print(table)
    missing = unseen(designed)
    if missing:
        console.print(
            Text(f"{count(missing, 'parameter')} will not be identifiable", style="yellow")
        )
    console.print()
    advice = helpful(designed.advice)[:MOST_ADVICE_LINES]
    for more in advice if verbose else advice[:1]:
        what = f"{capitalised(more.what)} ({seconds_text(more.seconds)}) reduces the std of "
        console.print(Text(what + brings(designed, more, 1)))
    if verbose:
        scope = scopes(designed)
        for line in (
            *([f"limits: {scope}"] if scope else []),
            "inflation: std divided by what it would be if all other parameters were known (√VIF)",
            f"noise: {designed.noise_from}",
            *(f"note: {n}" for n in designed.notes if n not in designed.certificate.uncovered),
        ):
            console.print(Text(line))
