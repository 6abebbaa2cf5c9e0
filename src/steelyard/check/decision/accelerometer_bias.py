r"""Has the accelerometer of a floating base a bias, and what of it could hide in masses?

Of a robot that stays about upright a bias $b$ along gravity acts like masses that are $b / g$
larger; only accelerations, and turns, tell the two apart.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from steelyard.check.cases_and_checks import Case, case_check
from steelyard.check.decision.contact_places import half_widths
from steelyard.check.decision.places_and_bias_beside_bodies import (
    Bounds,
    FittedBeside,
    beside_bodies,
)
from steelyard.check.decision.verdict_of_log import SURE
from steelyard.check.finding import Finding, Fix
from steelyard.report.words import percent
from steelyard.robot.file.signals import BaseSignals

BOUNDS = Bounds(least=0.05, unknown=0.5, sure=10.0)
"""Of a bias [m/s²]: from half a percent of masses on; slow sways are off by 8 deviations."""


@case_check("accelerometer bias", "Is the accelerometer of the base without bias?")
def accelerometer_bias_check(case: Case) -> Iterable[Finding]:
    """The bias with which free bodies fit best, and the masses that it could be."""
    for log in case.logs:
        base = log.recording.signals.base
        if base is None or base.tracked:
            continue
        found = beside_bodies(case, log)
        if found is None:
            one = Finding.ok("undecided: free link inertias cannot be fitted", answered=False)
        else:
            one = _finding(found, base)
        yield replace(one, log=log.name)


def _finding(found: FittedBeside, base: BaseSignals) -> Finding:
    axes, bias = np.reshape(base.axes, (3, 3)), found.bias(BOUNDS)
    size = float(np.linalg.norm(found.up))
    if not np.isfinite(bias.covariance).all() or size == 0.0:
        says = "these data do not show a bias of the accelerometer"
        return Finding.ok(says, answered=False)
    turned = replace(bias, value=axes.T @ bias.value, covariance=axes.T @ bias.covariance @ axes)
    up = found.up / size
    each = ", ".join(
        f"{name} {x:+.3f} ± {h:.2g}"
        for name, x, h in zip("xyz", turned.value, half_widths(turned), strict=True)
    )
    figure = (
        f"{each} m/s² along the sensor's axes, with 95 % intervals; log-likelihood rises by "
        f"{bias.gain:.0f} (doubtful from {bias.least:.2g} m/s² and {SURE:g} on)"
    )
    if not bias.there or bias.gain < SURE:
        far = BOUNDS.sure * float(np.sqrt(up @ bias.covariance @ up))
        hidden = max(BOUNDS.least, far)
        says = (
            f"a bias of the accelerometer along gravity below {hidden:.2g} m/s² would not be seen, "
            f"and is not in the intervals: {percent(100.0 * hidden / size)} of all masses"
        )
        return Finding.ok(says, figure, answered=False, headline=True)
    whole = ", ".join(f"{x:.3f}" for x in np.array(base.bias) + turned.value)
    along = float(up @ bias.value)
    tilt = float(np.rad2deg(np.linalg.norm(bias.value - along * up) / size))
    return Finding.doubtful(
        f"the accelerometer may have a bias of {bias.size:.2g} m/s²: with free link inertias that "
        f"fits better, and without it {percent(100.0 * abs(along) / size)} of all masses would be "
        "wrong",
        figure,
        fix=Fix(
            "measure it, with the base at rest on all its sides, and state it in [signals.base]: "
            f"acceleration_bias = [{whole}] fits best; a mounting that is off by {tilt:.2g}° has a "
            "similar effect across gravity"
        ),
    )
