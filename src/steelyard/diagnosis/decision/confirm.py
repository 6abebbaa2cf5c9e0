"""A correct is tried on the robot file itself before it is proposed."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.decision.verdict import Verdict
from steelyard.diagnosis.finding import Edit
from steelyard.diagnosis.likelihood.excerpt import excerpt_of
from steelyard.diagnosis.likelihood.likelihood import likelihood_of
from steelyard.errors import SteelyardError
from steelyard.robot_file.loaded import LoadedRobot

CLOSE = 1.05
"""Typical misfit over that of the winner up to which the edits do what they should."""
SLACK = 0.5
"""And what rounding may add [%]."""


def confirmed(case: Case, evidence: Evidence, edits: Sequence[Edit], decision: Verdict) -> bool:
    """Whether the edited robot file reads the log as the winner does.

    True where there is no robot file of that content, such as for a bare URDF.
    """
    from steelyard.robot_file.edits import edited
    from steelyard.robot_file.file import load_robot, robot_text

    source = case.loaded.sources[0] if case.loaded.sources else None
    if not edits or source is None or source.path.suffix.lower() != ".toml":
        return True
    if not source.path.is_file():
        return True
    try:
        text = robot_text(source.path)
        if hashlib.sha256(text.encode()).hexdigest() != source.sha256:
            return True
        corrected = load_robot(source.path, edited(text, edits))
    except SteelyardError:
        return False
    return _reads_alike(evidence, decision, corrected)


def _reads_alike(evidence: Evidence, decision: Verdict, corrected: LoadedRobot) -> bool:
    """Whether signals and gravity give the misfit of the last winner that is to be written."""
    signals = corrected.signals
    if signals is None:
        return False
    likelihood, last = decision.ranking.likelihood, decision.written[-1]
    recording = replace(evidence.recording, signals=signals)
    excerpt = excerpt_of(recording, evidence.processing, likelihood.excerpt.cutoff)
    if excerpt is None:
        return False
    unknown = np.array(signals.unknown_gains or [False] * signals.n)
    gains = np.where(unknown, likelihood.gains, signals.gains)
    again = likelihood_of(
        excerpt, signals, likelihood.knowledge, corrected.robot, gains, likelihood.scales
    )
    score = again.score(again.declared.changed(payload=last.interpretation.payload))
    return (
        float(score.percent[0])
        <= CLOSE * float(likelihood.score(last.interpretation).percent[0]) + SLACK
    )
