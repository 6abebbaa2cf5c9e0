"""Do contacts of a floating base touch where they are declared?"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Z95, Array
from steelyard.check.cases_and_checks import Case, case_check
from steelyard.check.decision.places_and_bias_beside_bodies import (
    Bounds,
    FittedVector,
    beside_bodies,
)
from steelyard.check.decision.verdict_of_log import SURE
from steelyard.check.finding import Finding, Fix
from steelyard.robot.file.signals import Contact, Touch

LEAST_OFF = 0.005  # distance from the declared point that matters [m]
UNKNOWN_OFF = 0.01  # distance that must be seen in a direction for it to be known [m]
FAR_OFF = 0.1  # distance from which on another error is as likely [m]


@dataclass(frozen=True, eq=False)
class FittedPlace:
    """Where a contact fits best."""

    contact: Contact | Touch
    off: FittedVector  # from the declared place, along the axes of its frame [m]

    @property
    def words(self) -> str:
        """Where it fits best, with its interval, in mm from the declared place."""
        each = (
            f"{name} {1e3 * x:+.1f} ± {1e3 * h:.1f}" if np.isfinite(h) else f"{name} unknown"
            for name, x, h in zip("xyz", self.off.value, half_widths(self.off), strict=True)
        )
        return f"'{self.contact.frame}' {', '.join(each)} mm"


def half_widths(found: FittedVector) -> Array:
    """Half of the 95 % intervals along the axes, shape `(3,)`."""
    return np.asarray(Z95 * np.sqrt(np.diag(found.covariance)))


@case_check("contact places", "Do contacts touch where they are declared?")
def contact_places_check(case: Case) -> Iterable[Finding]:
    """The points of contacts at which free bodies fit best, of measured forces or of flags."""
    for log in case.logs:
        base = log.recording.signals.base
        contacts = () if base is None else base.touches or base.contacts
        if all(isinstance(contact, Touch) and contact.sole for contact in contacts):
            continue
        found = beside_bodies(case, log)
        if found is None:
            one = Finding.ok("undecided: free link inertias cannot be fitted", answered=False)
        else:
            offsets = found.places(Bounds(LEAST_OFF, UNKNOWN_OFF))
            pairs = zip(found.contacts, offsets, strict=True)
            one = _finding([FittedPlace(contacts[k], off) for k, off in pairs])
        yield replace(one, log=log.name)


def _finding(found: Sequence[FittedPlace]) -> Finding:
    gain = found[0].off.gain
    figure = (
        f"from the declared places, with 95 % intervals: {'; '.join(x.words for x in found)}; "
        f"log-likelihood rises by {gain:.0f} (doubtful from {1e3 * LEAST_OFF:g} mm and {SURE:g} on)"
    )
    others = [x for x in found if x.off.there and gain >= SURE]
    if others:
        return _other_places(others, figure)
    open_ones = [f"'{x.contact.frame}'" for x in found if not x.off.known]
    if open_ones:
        says = (
            f"these data do not show where forces act at {', '.join(open_ones)} to "
            f"{1e3 * UNKNOWN_OFF:g} mm: intervals assume that the declared point is right"
        )
        return Finding.ok(says, figure, answered=False, headline=True)
    least = max(x.off.least for x in found)
    return Finding.ok(f"contacts touch within {1e3 * least:.2g} mm of the declared places", figure)


def _other_places(others: Sequence[FittedPlace], figure: str) -> Finding:
    each = ", ".join(f"{1e3 * x.off.size:.3g} mm away at '{x.contact.frame}'" for x in others)
    says = f"contacts may touch at other points than declared: with free link inertias {each}"
    fits = [
        f"[{', '.join(f'{x:.4f}' for x in np.array(one.contact.place) + one.off.value)}] m at "
        f"'{one.contact.frame}'"
        for one in others
        if isinstance(one.contact, Touch)
    ]
    advice = "measure where they touch: "
    advice += (
        f"position of the contact (fits best: {', '.join(fits)})"
        if fits
        else "the frame of the contact, in the model file"
    )
    if any(x.off.size >= FAR_OFF for x in others):
        advice += "; so far off, a sign, an order or a gain that is wrong is as likely"
    return Finding.doubtful(says, figure, fix=Fix(advice))
