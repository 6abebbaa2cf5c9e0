r"""Signs that friction determines without any masses: it dissipates.

Each effort row is fitted by least squares of its own, bodies and springs free beside Coulomb and
viscous friction. The fitted friction's power over the log, $P_j = f_c \sum |\dot q| + f_v \sum
\dot q^2$, cannot be negative; where it is, far beyond its standard error and of a size that counts,
the effort or the position of that joint counts the other way.
"""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Edit, Finding, Fix, Severity
from steelyard.diagnosis.identifiability import clean_runs, customary_model
from steelyard.errors import SteelyardError
from steelyard.regression.gather import gather
from steelyard.regression.information import Information
from steelyard.regression.regressor import base_regressor
from steelyard.terms.laws.coulomb import Coulomb
from steelyard.terms.laws.viscous import Viscous

SURE = 6.0
"""Standard errors by which friction must be negative."""
LEAST = 0.05
"""Least size of that friction, relative to the joint's effort without its mean."""
EXPLAINED = 0.7
"""Share of the effort's variance that the fit must explain: else something else is wrong."""
SINGULAR = 1e-9
"""Eigenvalue of a row's normalised Gram matrix, over the largest, that counts as zero."""
LAWS = (Coulomb.law, Viscous.law)
FEWEST = 6
"""Windows of a run from which on its scores give a standard error."""


@dataclass(frozen=True, eq=False)
class Drive:
    """What the friction of one row does, in the units of its effort.

    Attributes:
        size: Rms of its friction, negative where it drives the joint, over the rms effort.
        std: Standard error of that.
        explained: Share of the squared effort that the fit explains.
    """

    size: float
    std: float
    explained: float

    @property
    def drives(self) -> bool:
        """Whether friction certainly drives the joint."""
        return self.explained >= EXPLAINED and self.size < -LEAST and self.size < -SURE * self.std

    @property
    def brakes(self) -> bool:
        """Whether friction certainly takes energy."""
        return self.explained >= EXPLAINED and self.size > SURE * self.std


def friction_signs(case: Case, name: str) -> tuple[Finding, ...]:
    """One finding per log whose friction drives joints; none where it takes energy, or is small.

    Args:
        case: Robot and logs.
        name: Name of the check.
    """
    found = []
    for evidence in case.logs:
        finding = _of_log(case, evidence, name)
        found += [] if finding is None else [finding]
    return tuple(found)


def _of_log(case: Case, evidence: Evidence, name: str) -> Finding | None:
    signals = evidence.recording.signals
    if signals.effort_map is not None:
        return None
    drives = drives_of(case, evidence)
    driven = [j for j, d in drives.items() if d.drives]
    if not driven:
        return None
    braked = [j for j, d in drives.items() if d.brakes]
    worst = min((drives[j] for j in driven), key=lambda d: d.size)
    figure = (
        f"friction of {100.0 * worst.size:.0f} % of the effort (standard error "
        f"{100.0 * worst.std:.2g} %), at least {-100.0 * LEAST:.0f} % required"
    )
    listed = ", ".join(f"'{j}'" for j in driven)
    if not braked and 2 * len(driven) > len(case.joints) > 1:
        says = (
            "all efforts or all positions have the wrong sign: friction drives "
            f"{listed} instead of braking, and is dissipative in no joint"
        )
        gains = [-float(g) for g in signals.gains]
        edits = (
            ()
            if any(signals.unknown_gains) or case.loaded.robot.transmission
            else (Edit(("signals", "effort", "gain"), gains),)
        )
        fix = Fix("change the signs of all gains", edits)
        return Finding(name, evidence.name, Severity.WRONG, says, figure, tuple(driven), fix)
    says = (
        f"effort of {listed} has the wrong sign, or the position has: friction "
        "drives instead of braking"
    )
    fix = Fix(
        f"find out which of the two it is: change the sign of the gain of {listed}, or of its "
        "position (position_sign under [signals])"
    )
    return Finding(name, evidence.name, Severity.DOUBTFUL, says, figure, tuple(driven), fix)


def drives_of(case: Case, evidence: Evidence) -> dict[str, Drive]:
    """What friction does in every joint that a log shows; none where it cannot be fitted."""
    try:
        runs = clean_runs(Case(case.loaded, (evidence,)))
        if not runs:
            return {}
        information = gather(base_regressor(customary_model(case)), runs[0])
    except (SteelyardError, TypeError):
        return {}
    found, gains = {}, evidence.recording.signals.gains
    for row, joint in enumerate(case.joints):
        drive = _drive(information, row, joint, float(np.sign(gains[row])))
        if drive is not None:
            found[joint] = drive
    return found


def _drive(information: Information, row: int, joint: str, sign: float) -> Drive | None:
    """What one row's own least squares says of its friction; `None` where it says nothing.

    Args:
        information: Of the run, efforts as logged.
        row: The row.
        joint: Its joint.
        sign: Of the joint's gain.
    """
    columns = [information.layout.columns[k] for k in information.layout.sees[row]]
    names = [f"{law}.{joint}" for law in LAWS]
    grams = information.row_grams(row)
    if len(grams) < FEWEST or not set(names) <= set(columns):
        return None
    gram = grams.sum(axis=0)
    dry, viscous = (columns.index(name) for name in names)
    lengths = np.sqrt(np.diag(gram)[:-1])
    if gram[-1, -1] <= 0.0 or min(lengths[dry], lengths[viscous]) <= 0.0:
        return None
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    values, vectors = np.linalg.eigh(gram[:-1, :-1] / lengths[:, None] / lengths)
    kept = values > SINGULAR * values.max()
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T / lengths[:, None] / lengths
    theta = inverse @ gram[:-1, -1]
    left = float(gram[-1, -1] - theta @ gram[:-1, -1])
    effort = _varying(gram, columns, joint)
    power = np.zeros(len(theta))
    power[[dry, viscous]] = gram[viscous, [dry, viscous]]
    power /= np.sqrt(gram[viscous, viscous] * effort)
    scores = (grams[:, :-1, -1] - grams[:, :-1, :-1] @ theta) @ (inverse @ power)
    freedom = max(float(information.n_samples[row]) - float(kept.sum()), 1.0)
    white = left / freedom * float(power @ inverse @ power)
    windows = float(np.sum(np.square(scores))) * len(scores) / (len(scores) - 1)
    std = float(np.sqrt(max(white, windows, 0.0)))
    return Drive(sign * float(power @ theta), std, 1.0 - left / effort)


def _varying(gram: Array, columns: list[str], joint: str) -> float:
    """Sum of the squares of a row's effort without its mean."""
    whole = float(gram[-1, -1])
    if f"offset.{joint}" not in columns:
        return whole
    k = columns.index(f"offset.{joint}")
    return max(whole - float(gram[k, -1]) ** 2 / max(float(gram[k, k]), 1e-300), 1e-12 * whole)
