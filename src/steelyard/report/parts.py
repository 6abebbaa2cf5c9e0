"""The samples that figures about efforts and their causes are drawn from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from steelyard.report.content import ReportContent
from steelyard.report.text.words import count
from steelyard.validation.torque_parts import TorqueParts

if TYPE_CHECKING:
    from steelyard.validation.score import RunScore


def fitted_samples(content: ReportContent) -> tuple[TorqueParts, str] | None:
    """Samples of the fitted runs, else of the others, and what they are; or `None`."""
    return _pooled(content.fitted, "fitted") or _pooled(content.scores, "validation")


def unseen_samples(content: ReportContent) -> tuple[TorqueParts, str] | None:
    """Samples of runs that were not fitted, else of the others, and what they are."""
    return _pooled(content.scores, "validation") or _pooled(content.fitted, "fitted")


def _pooled(scores: Sequence[RunScore], kind: str) -> tuple[TorqueParts, str] | None:
    """The samples of several runs one after another."""
    known = [score.parts for score in scores if score.parts is not None]
    if not known:
        return None
    pooled = TorqueParts(
        t=np.concatenate([one.t for one in known]),
        q=np.concatenate([one.q for one in known]),
        dq=np.concatenate([one.dq for one in known]),
        moving=np.concatenate([one.moving for one in known]),
        measured=np.concatenate([one.measured for one in known]),
        parts=np.concatenate([one.parts for one in known], axis=1),
    )
    return pooled, count(len(known), f"{kind} run")
