"""The verdict on a model from its errors on unseen motion, and the next commands."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

from steelyard.check.finding import Finding
from steelyard.estimate.scores.effort_errors import EffortError, as_logged, known_efforts, pooled
from steelyard.estimate.scores.score import RunScore
from steelyard.identify.page.parameters_and_truth import parameter_rows
from steelyard.identify.page.report_content_and_error_words import (
    MOST_NAMED_JOINTS,
    ReportContent,
    basis_words,
    both_words,
    error_words,
    limit_words,
    loaded_joints,
    other_errors,
    without_percentage,
    worse_joints,
)
from steelyard.report.words import Level, count, first_names, percent

MOST_GOOD_PERCENT = 10.0  # relative error [%] up to which a joint counts as well predicted
MOST_FAIR_PERCENT = 30.0  # relative error [%] up to which it counts as fairly predicted
USELESS_PERCENT = 95.0
"""Relative error [%] from which on a joint is predicted no better than by zero: the model explains
less than a tenth of its mean square effort."""
USELESS_SHARE = 0.5  # of the joints with load so predicted from which on a model is poor
LEVELS_BEST_FIRST: tuple[Level, ...] = ("good", "none", "fair", "poor")  # levels, the best first

BEST_LEVEL_BY_SEVERITY: dict[str, Level] = {"ok": "none", "doubtful": "fair", "wrong": "poor"}
"""The best level that a limitation of this severity leaves; one that is ok leaves every level."""

AT_REST = (
    "At rest, friction has any value up to the breakaway (static) friction. The error includes "
    "this unknown friction: the log validates gravity only"
)


@dataclass(frozen=True)
class Limitation:
    """What was found against a model."""

    text: str  # what, where, the evidence, and what to do
    brief: str  # the same for a line of a terminal
    level: Level  # the best level that it leaves


@dataclass(frozen=True)
class Verdict:
    """A headline, the small print under it, how good it is, and what qualifies it."""

    headline: str  # one sentence, with the joints that are worse than good
    detail: str  # what it was computed from
    level: Level  # no better than the worst limitation allows
    limitations: tuple[Limitation, ...] = ()  # everything that was found against the model
    errors: tuple[EffortError, ...] = ()  # one per unit of effort; none without an unseen run
    as_logged: tuple[EffortError, ...] = ()  # against efforts as logged, if scales were estimated
    others: str = ""  # the relative errors in the validation band, as a sentence; or nothing
    scope: str = ""  # which share of the joints is good, like `4 of 6 joints`; empty if all are
    worse: tuple[str, ...] = ()  # the other joints with their errors, the worst first
    unseen: bool = True  # whether the errors are of motion that was not fitted

    @property
    def percent_of_used(self) -> float | None:
        """The largest error over units of effort, with and without estimated scales [%].

        Which of the two is that of the model depends on whether the sensors or the model are off.
        """
        every = (*self.errors, *self.as_logged)
        return max((one.percent_of_used for one in every), default=None)

    @property
    def line(self) -> str:
        """The headline behind its level in capitals; alone where there is nothing to judge by.

        Behind `good` stands for how many joints, if not for all; the headline names the others.
        """
        return self.headline if self.level == "none" else f"{self.grade}: {self.headline}"

    @property
    def grade(self) -> str:
        """The level in capitals; behind `good` for how many joints, if not for all."""
        scope = f" for {self.scope}" if self.scope and self.level == "good" else ""
        return f"{self.level.upper()}{scope}"

    def to_dict(self) -> dict[str, Any]:
        """As JSON values, without the limitations."""
        return {
            "level": self.level,
            "scope": self.scope,
            "worse": list(self.worse),
            "headline": self.headline,
            "detail": self.detail,
            "errors": [one.to_dict() for one in self.errors],
            "errors_as_logged": [one.to_dict() for one in self.as_logged],
        }


def level_of(relative_percent: float | None) -> Level:
    """How good a relative error [%], as printed, to 0.1 %, is; `none` if there is no number."""
    if relative_percent is None or relative_percent != relative_percent:
        return "none"
    printed = round(relative_percent, 1)
    fair: Level = "fair" if printed <= MOST_FAIR_PERCENT else "poor"
    return "good" if printed <= MOST_GOOD_PERCENT else fair


def verdict(content: ReportContent) -> Verdict:
    """The verdict of a report, no better than its limitations allow."""
    scores = [run for run in content.scores if not run.repeats] or list(content.scores)
    found, levels = [], []
    if scores:
        plain = _judged(scores, _motion(scores), unseen=not scores[0].repeats)
    else:
        plain = _untested(content)
    for one in content.limitations:
        figure = f" ({one.figure})" if one.figure else ""
        advice = f". {one.fix.says}" if one.fix is not None else ""
        place = f"{one.log}: " if one.log else ""
        text = f"{place}{one.says}{figure}{advice}"
        best = BEST_LEVEL_BY_SEVERITY[one.severity.word]
        found.append(Limitation(text, f"{place}{one.brief}" if one.brief else text, best))
        levels += [best] if one.severity else []
    level, detail = max([plain.level, *levels], key=LEVELS_BEST_FIRST.index), plain.detail
    if level != plain.level != "none":
        detail += (
            f" {plain.level.upper()} by this error, {level.upper()} because of what checks found."
        )
    return replace(plain, level=level, detail=detail, limitations=tuple(found))


def exit_code(content: ReportContent) -> int:
    """Of a command that did its work: 1 if the verdict is poor, so that scripts stop there."""
    return int(verdict(content).level == "poor")


def poorly_predicted(scores: Sequence[RunScore]) -> tuple[str, ...]:
    """Each run whose error alone is poor, like `run.csv with an error of 3.9 Nm: 50 % of ...`."""
    poor = [one for one in scores if _judged([one], "", unseen=True).level == "poor"]
    return tuple(f"{x.run} with an error of {error_words(pooled([x.errors]))}" for x in poor)


def error_limit_words(judged: Verdict, most: float | None) -> str:
    """That an error is above a limit [%], or that there is none of unseen motion; else empty."""
    if most is None:
        return ""
    error = judged.percent_of_used
    if error is None or not judged.unseen:
        return f"No error on unseen motion to compare with --max-error {most:g} %"
    if error <= most:
        return ""
    return f"The error of {percent(error)} is above --max-error {most:g} %"


def _judged(scores: Sequence[RunScore], motion: str, *, unseen: bool) -> Verdict:
    """The verdict of scores on a motion; none that is good or fair where it is not unseen."""
    errors = pooled(run.errors for run in scores)
    logged = pooled(as_logged(run.errors for run in scores))
    again = ", ".join(dict.fromkeys(run.repeats for run in scores if run.repeats))
    repeated = f"It repeats the motion of the fitted run {again}: no validation on other motions"
    sentences = ["; ".join(filter(None, (basis_words(scores), limit_words(errors))))]
    if again:
        sentences.append(repeated)
    if any(run.errors.at_rest for run in scores):
        sentences.append(AT_REST)
    detail, others = (" ".join(f"{sentence}." for sentence in sentences)), other_errors(scores)
    plain = Verdict("", detail, "none", (), errors, logged, others, unseen=unseen)
    worst = plain.percent_of_used
    scaled = max((one.percent_of_used for one in errors), default=0.0)
    if worst is None or not isfinite(worst):
        why = f"No relative error of {', '.join(without_percentage(scores))}: its measured effort"
        detail = f"{why} is zero or not a number. See the table. {detail}"
        headline = f"The error on {motion} cannot be given as a percentage"
        return replace(plain, headline=headline, detail=detail)
    worse = worse_joints(scores, MOST_GOOD_PERCENT)
    moving = len({j.joint for run in scores for j in run.errors.joints if j.counted})
    limited: Level = "good" if worst <= MOST_GOOD_PERCENT and 2 * len(worse) <= moving else "fair"
    level = max(level_of(scaled), limited, key=LEVELS_BEST_FIRST.index)
    loaded = loaded_joints(scores)
    useless = sum(error.percent_of_used >= USELESS_PERCENT for error in loaded)
    named = len(worse) if level == "good" else max(MOST_NAMED_JOINTS, useless)
    error = both_words(errors, logged) + (f" ({first_names(worse, named)})" if worse else "")
    scope = f"{moving - len(worse)} of {count(moving, 'joint')}" if worse else ""
    plain = replace(plain, scope=scope, worse=worse)
    where = "" if scaled >= 100.0 else f" at {useless} of {count(len(loaded), 'joint')}"
    if scaled >= 100.0 or (useless and useless >= USELESS_SHARE * len(loaded)):
        headline = f"Predicts {motion} no better than predicting zero{where}: the error is {error}"
        return replace(plain, headline=headline, level="poor")
    if not unseen:
        level = max(level, "none", key=LEVELS_BEST_FIRST.index)
    return replace(plain, headline=f"Predicts {motion} with an error of {error}", level=level)


def _motion(scores: Sequence[RunScore]) -> str:
    """What was predicted, and from what if that is not the measured motion."""
    motion = "unseen postures" if all(run.errors.at_rest for run in scores) else "unseen motion"
    motion = "repeated motion" if scores[0].repeats else motion
    commanded = any(run.predicted_from == "commanded" for run in scores)
    return f"efforts of {motion} from the commanded motion" if commanded else motion


UNTESTED = "Not validated on unseen motion"


def _untested(content: ReportContent) -> Verdict:
    """Without a run that was kept aside nothing is known of other motions, but of a poor fit."""
    fitted, described = content.fitted, ""
    to_do = "To validate it, log another motion and run: steelyard validate MODEL OTHER_LOG"
    if not fitted:
        return Verdict(UNTESTED, to_do, "none")
    judged = _judged(fitted, "fitted motion", unseen=False)
    if judged.level == "poor":
        headline, detail = f"{UNTESTED}. {judged.headline}", f"{judged.detail} {to_do}"
        return replace(judged, headline=headline, detail=detail, errors=(), as_logged=())
    if judged.errors and all(isfinite(one.percent_of_used) for one in judged.errors):
        error = both_words(judged.errors, judged.as_logged)
        described = (
            f"The model describes {count(len(fitted), 'fitted run')} with an error of {error} "
            f"({basis_words(fitted)}), which is no evidence for other motions. "
        )
    return Verdict(UNTESTED, f"{described}{to_do}", "none", others=judged.others)


MODEL_ERROR = "model error"  # the check that compares residuals with noise
GEAR_SIDE = "gear side"  # the check of rotor inertias at zero

MOST_WEAK_SHARE = 1.0 / 3.0
"""Share of base parameters that are poorly identified or not at all, above which a motion is
advised; any share where a good model is not good for every joint."""

WEAK_STATUSES = ("poorly identified", "not identifiable")  # other motion identifies them
Step = tuple[str, str]  # a command, or nothing, and a remark: why, or what to change


def next_steps(content: ReportContent, robot: str, model: Path) -> tuple[Step, ...]:
    """Steps after an identification, the most urgent first."""
    judged, table = verdict(content), parameter_rows(content.identified)
    weak = sum(row.status in WEAK_STATUSES for row in table) / max(len(table), 1)
    steps = list(fix_commands(content, str(model), robot))
    weigh = f"{identify_command(robot, [*content.logs.values()])} --loaded LOG --payload-mass KG"
    robot, folder = path_word(robot), path_word(model)
    logs = " ".join(path_word(log) for log in content.logs.values())
    if content.diagnosis is not None and content.diagnosis.inconclusive:
        steps.insert(0, (f"steelyard check {robot} {logs}", "open questions about the robot file"))
    steps += gear_side_steps(content.limitations, robot)
    if judged.level == "poor" and not steps:
        steps.append((f"steelyard check {robot} {logs}", "errors in the logs or the robot file"))
    if not content.scores:
        steps.append((f"steelyard validate {folder} OTHER_LOG", "error on another motion"))
    if content.friction is None and any(
        found.check == MODEL_ERROR and not found.severity for found in content.limitations
    ):
        remark = f'to have friction laws chosen from the logs: friction = "auto" in {robot}, '
        steps.append(("", f'{remark}[model], and no "coulomb", "viscous" in terms'))
    if weak > MOST_WEAK_SHARE or (weak and judged.level == "good" and judged.scope):
        command = f"steelyard excite {robot} --earlier {folder} --still-unknown"
        steps.append((command, "a motion for parameters that are poorly identified or not at all"))
    if judged.level == "good" and not all(known_efforts(content.identified)):
        steps.append((weigh, "gains in Nm per A; until then no torques, no URDF"))
    elif judged.level == "good":
        more = "payload" if content.identified.robot.floating else OTHER_USES
        uses = f"use the model, here as a URDF; also: {more}"
        steps.append((f"steelyard export {folder} --to urdf", uses))
    return tuple(steps)


OTHER_USES = "feedforward, wrench, payload, watch"


def path_word(path: str | Path) -> str:
    """A path as a word of a command: from the current folder, if it lies in it, and quoted."""
    here, there = Path.cwd(), Path(path)
    return shlex.quote(str(there.relative_to(here)) if there.is_relative_to(here) else str(path))


def gear_side_steps(findings: Sequence[Finding], robot: str) -> list[Step]:
    """The edit for sensors on the link side, where a finding proposes it."""
    edit = f'if sensors are on the link side: kind = "link_torque" in {robot}, no rotor_inertia'
    proposed = any(found.check == GEAR_SIDE and found.fix is not None for found in findings)
    return [("", f"{edit} in terms")] if proposed else []


def identify_command(robot: str, logs: Sequence[str], cluster: str | None = None) -> str:
    """The command that identifies from all logs but the last one, which validates; or from one.

    On a cluster it takes all logs as they were given, folders and patterns among them.
    """
    words = [path_word(log) for log in logs]
    if cluster is not None:
        words += ["--cluster", cluster]
    elif len(words) > 1:
        words.insert(-1, "--validate")
    return " ".join(["steelyard", "identify", path_word(robot), *words])


def fix_commands(content: ReportContent, model: str, robot: str = "ROBOT") -> tuple[Step, ...]:
    """The commands that go on from what limits the verdict."""
    found = {}
    for one in content.limitations:
        if one.severity and one.fix is not None and one.fix.command:
            paths = {"MODEL": model, "ROBOT": robot, "LOG": content.logs.get(one.log, "LOG")}
            given = {word: path_word(path) for word, path in paths.items()}
            words = (given.get(word, word) for word in one.fix.command.split(" "))
            found[" ".join(words)] = ""
    return tuple(found.items())


def robot_file(content: ReportContent) -> str:
    """The robot file that the model was identified with, if it lies here; else `ROBOT`."""
    inputs = content.identified.provenance.inputs
    names = (role.removeprefix("robot ") for role in inputs if role.startswith("robot "))
    here = (name for name in names if name.endswith(".toml") and Path(name).is_file())
    return next(here, "ROBOT")


def step_lines(steps: tuple[Step, ...], indent: int = 8) -> list[str]:
    """The steps as lines of a terminal, `indent` columns for the heading; remarks as comments."""
    both = [line for step, why in steps for line in (f"# {why}" if why else "", step)]
    lines = list(filter(None, both))
    return [f"{'' if number else 'next':{indent}}{line}" for number, line in enumerate(lines)]
