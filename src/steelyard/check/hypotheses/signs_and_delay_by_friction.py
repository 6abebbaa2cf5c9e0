r"""What friction shows without known masses: signs of efforts, and their delay.

Each effort row is fitted by least squares of its own, bodies and springs free beside Coulomb and
viscous friction. The fitted friction's power over the log, $P_j = f_c \sum |\dot q| + f_v \sum
\dot q^2$, cannot be negative; where it is, far beyond its standard error and of a size that counts,
the effort or the position of that joint counts the other way.

Each effort row is fitted by least squares of its own at three delays; the sum of squares that is
left is a parabola of the delay, $S_j(d) = S_j + b_j d + \kappa_j d^2$. Logs that are late have the
same minimum in all joints, at all frequencies: what lags or leads by a time that differs between
joints, or between slow and fast motion, is a drive or an elastic joint. Joints that move slowly are
left out: there friction that gives way before it slips looks late as well [Dahl1968].
"""

from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import SteelyardError
from steelyard.check.cases_and_checks import Case, CheckedLog
from steelyard.check.finding import SURE_DEVIATIONS, Edit, Finding, Fix
from steelyard.check.hypotheses.gravity_payload_and_delay import LONGEST_DELAY
from steelyard.check.hypotheses.nuisance_fit_and_score import ROUNDING
from steelyard.estimate.information.base_parameters_and_regressor import Regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.information import Information
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.robot.file.signals import Signals
from steelyard.runs.prepare import prepare
from steelyard.runs.run import Run, fastest_of

LEAST_NEGATIVE_FRICTION = 0.05
"""Least size of that friction, relative to the joint's effort without its mean."""
EXPLAINED_BY_FRICTION_FIT = 0.7
"""Share of the effort's variance that the fit must explain: else something else is wrong."""
SIGNED_LAWS = (Coulomb.law, Viscous.law)
FEWEST_WINDOWS = 6  # windows of a run from which on its scores give a standard error


@dataclass(frozen=True, eq=False)
class RowFriction:
    """What the friction of one row does, in the units of its effort."""

    size: float  # rms of its friction, negative where it drives the joint, over the rms effort
    std: float  # standard error of that
    explained: float  # share of the squared effort that the fit explains

    @property
    def drives(self) -> bool:
        """Whether friction certainly drives the joint."""
        return (
            self.explained >= EXPLAINED_BY_FRICTION_FIT
            and self.size < -LEAST_NEGATIVE_FRICTION
            and self.size < -SURE_DEVIATIONS * self.std
        )

    @property
    def brakes(self) -> bool:
        """Whether friction certainly takes energy."""
        sure = self.size > SURE_DEVIATIONS * self.std
        return sure and self.explained >= EXPLAINED_BY_FRICTION_FIT


def friction_signs(case: Case) -> tuple[Finding, ...]:
    """One finding per log whose friction drives joints; none where it takes energy, or is small."""
    plain = [log for log in case.logs if log.recording.signals.effort_map is None]
    drives = {log: friction_of_rows(case, log) for log in plain}
    return tuple(
        replace(_friction_sign(case, log.recording.signals, rows), log=log.name)
        for log, rows in drives.items()
        if any(row.drives for row in rows.values())
    )


def _friction_sign(case: Case, signals: Signals, drives: dict[str, RowFriction]) -> Finding:
    driven = tuple(j for j, d in drives.items() if d.drives)
    worst = min((drives[j] for j in driven), key=lambda d: d.size)
    figure = (
        f"friction of {100.0 * worst.size:.0f} % of the effort (standard error "
        f"{100.0 * worst.std:.2g} %), at least {-100.0 * LEAST_NEGATIVE_FRICTION:.0f} % required"
    )
    listed = ", ".join(f"'{j}'" for j in driven)
    if not any(d.brakes for d in drives.values()) and 2 * len(driven) > len(case.joints) > 1:
        says = (
            "all efforts or all positions have the wrong sign: friction drives "
            f"{listed} instead of braking, and is dissipative in no joint"
        )
        edit = Edit(("signals", "effort", "gain"), [-float(g) for g in signals.gains])
        unwritten = any(signals.unknown_gains) or case.loaded.robot.transmission
        fix = Fix("change the signs of all gains", () if unwritten else (edit,))
        return Finding.wrong(says, figure, driven, fix)
    says = (
        f"effort of {listed} has the wrong sign, or the position has: friction "
        "drives instead of braking"
    )
    fix = Fix(
        f"find out which of the two it is: change the sign of the gain of {listed}, or of its "
        "position (position_sign under [signals])"
    )
    return Finding.doubtful(says, figure, driven, fix)


def friction_of_rows(case: Case, log: CheckedLog) -> dict[str, RowFriction]:
    """What friction does in every joint that a log shows; none where it cannot be fitted."""
    try:
        alone = case.only(log)
        if not alone.runs:
            return {}
        information = alone.information
    except (SteelyardError, TypeError):
        return {}
    signs = np.sign(log.recording.signals.gains).tolist()
    found = {
        joint: _friction_of_row(information, row, joint, signs[row])
        for row, joint in enumerate(case.joints)
    }
    return {joint: one for joint, one in found.items() if one is not None}


def _friction_of_row(
    information: Information, row: int, joint: str, sign: float
) -> RowFriction | None:
    """What one row's own least squares says of its friction; `None` where it says nothing."""
    columns = [information.layout.columns[k] for k in information.layout.sees[row]]
    names = [f"{law}.{joint}" for law in SIGNED_LAWS]
    grams = information.row_grams(row)
    if len(grams) < FEWEST_WINDOWS or not set(names) <= set(columns):
        return None
    gram = grams.sum(axis=0)
    dry, viscous = (columns.index(name) for name in names)
    if gram[-1, -1] <= 0.0 or min(gram[dry, dry], gram[viscous, viscous]) <= 0.0:
        return None
    own, fitted, left = own_fit(gram)
    inverse, theta = own @ own.T, own @ fitted
    effort = float(gram[-1, -1])  # without its mean
    if f"offset.{joint}" in columns:
        k = columns.index(f"offset.{joint}")
        mean = float(gram[k, -1]) ** 2 / max(float(gram[k, k]), 1e-300)
        effort = max(effort - mean, 1e-12 * effort)
    power = np.zeros(len(theta))
    power[[dry, viscous]] = gram[viscous, [dry, viscous]]
    power /= np.sqrt(gram[viscous, viscous] * effort)
    scores = (grams[:, :-1, -1] - grams[:, :-1, :-1] @ theta) @ (inverse @ power)
    freedom = max(float(information.n_samples[row]) - own.shape[1], 1.0)
    white = left / freedom * float(power @ inverse @ power)
    windows = float(np.sum(np.square(scores))) * len(scores) / (len(scores) - 1)
    std = float(np.sqrt(max(white, windows, 0.0)))
    return RowFriction(sign * float(power @ theta), std, 1.0 - left / effort)


DELAY_SHIFT = 0.008  # delay that is tried to both sides [s]
LEAST_RESIDUAL_DELAY = 1e-3  # least delay [s]
FAST = 0.3
"""Share of its top speed from which on a joint is looked at: more slowly, friction that no law has
looks up to 25 ms late, or 4 ms early."""
ROW_ERROR = 0.05  # standard error of a delay that is left within a row, in rows
EXPLAINED_BY_DELAY = 0.25
"""Share of the typical squared residual that a delay must explain: up to 0.14 on real robots."""
SLOW_BAND = 0.25  # cut-off below which the delay must be the same, over that of the regression
ROWS_OF_ONE_DELAY = 0.75  # share of the moving rows whose squares must have a minimum


@dataclass(frozen=True, eq=False)
class RowDelays:
    """What the rows of one run say of the delay."""

    delay: float  # of all rows together [s]
    std: float  # its standard error, with `spread` as it is: what biases one row biases others [s]
    spread: float  # of the rows' delays around it [s]
    before: float  # typical squared residual without it
    after: float  # and with it
    rows: int  # how many rows are used
    moving: int  # of how many that have samples enough

    @property
    def gone(self) -> float:
        """Share of the typical squared residual that the delay explains."""
        return 1.0 - self.after / max(self.before, 1e-300)

    @property
    def sure(self) -> bool:
        """Whether all rows are late, or early, by one time that explains much of the residual."""
        least = max(LEAST_RESIDUAL_DELAY, SURE_DEVIATIONS * self.std)
        return self.rows > 1 and self.gone >= EXPLAINED_BY_DELAY and abs(self.delay) >= least


def residual_delay(case: Case) -> Finding | None:
    """The delay that the longest log shows, for all logs together; `None` if it shows none.

    A log with gaps is not looked at: what filters leave beside a gap may look late.
    """
    try:
        longest = case.longest_run()
        if longest is None or len(longest[1].segments) > 1:
            return None
        log, run = longest[0], _fast_motion(longest[1])
        found = delays_of(case.regressor, run)
        if found.gone >= 0.5 * EXPLAINED_BY_DELAY:
            found = replace(_renewed(case.regressor, run, found.delay), before=found.before)
        if not found.sure:
            return None
    except (SteelyardError, TypeError):
        return None
    ms, whole = 1e3 * found.delay, log.recording.signals.effort_delay + found.delay
    way, spread = "late" if ms > 0.0 else "early", found.std / max(abs(whole), 1e-6)
    says = (
        f"efforts are {abs(ms):.3g} ms {way} (± {2e3 * found.std:.2g}): the residuals of a fit of "
        f"{log.name} indicate this delay in all {found.rows} joints"
    )
    figure = (
        f"a delay explains {100.0 * found.gone:.0f} % of the squared residual (at least "
        f"{100.0 * EXPLAINED_BY_DELAY:.0f} % required), joints differ by {1e3 * found.spread:.2g} "
        f"ms (at most {abs(ms) / SURE_DEVIATIONS:.2g} allowed)"
    )
    if against := no_common_delay(case, log, found.delay):
        return Finding.doubtful(f"{says}, but {against}", figure, fix=Fix(NO_DELAY_ADVICE))
    return Finding.wrong(
        says,
        figure,
        fix=Fix(
            f"efforts are {abs(ms):.3g} ms {way}: state the delay",
            (Edit(("signals", "effort", "delay"), round(whole, 4), spread),),
        ),
    )


NO_DELAY_ADVICE = (
    "compare the unseen error with and without [signals.effort] delay before stating one: a drive, "
    "a filter of the efforts or an elastic joint shifts slow and fast motion by different times"
)


def no_common_delay(case: Case, log: CheckedLog, delay: float) -> str:
    """What speaks against one delay of all efforts, beside the declared one; empty if nothing does.

    All joints must have it, and slow motion as much as fast motion.
    """
    try:
        (run,) = case.only(log).runs or (None,)
        if run is None:
            return ""
        slowly = replace(
            log.processing,
            motion_cutoff=run.motion_cutoff,
            matched_cutoff=SLOW_BAND * run.matched_cutoff,
        )
        found = {
            "": _renewed(case.regressor, _fast_motion(run), delay),
            f" below {SLOW_BAND * run.matched_cutoff:.2g} Hz": _renewed(
                case.regressor, _fast_motion(prepare(log.recording, slowly)), delay
            ),
        }
    except (SteelyardError, TypeError):
        return ""
    for band, one in found.items():
        if (one.rows > 1 or not band) and one.rows < ROWS_OF_ONE_DELAY * one.moving:
            return f"only {one.rows} of {one.moving} moving joints show one{band}"
        if one.rows > 1 and SURE_DEVIATIONS * one.spread > abs(delay):
            return f"joints do not share it{band}: they differ by {1e3 * one.spread:.2g} ms"
        if abs(one.delay - delay) > max(abs(delay) / SURE_DEVIATIONS, 2.0 * one.std):
            return f"a fit of the fast motion{band} shows {1e3 * one.delay:.2g} ms"
    return ""


def _fast_motion(run: Run) -> Run:
    return replace(run, rest_speed=np.maximum(run.rest_speed, FAST * fastest_of([run])))


def _renewed(regressor: Regressor, run: Run, delay: float) -> RowDelays:
    """The delay found anew around one that is known roughly."""
    start = float(np.clip(delay, -LONGEST_DELAY, LONGEST_DELAY))
    found = delays_of(regressor, _with_delay(run, start))
    return replace(found, delay=start + found.delay)


def delays_of(regressor: Regressor, run: Run) -> RowDelays:
    """What the residuals of least squares, row by row, say of the delay."""
    shifts = (-DELAY_SHIFT, 0.0, DELAY_SHIFT)
    (early, _), (left, freedom), (late, _) = (
        _squares(gather(regressor, _with_delay(run, shift))) for shift in shifts
    )
    slope = (late - early) / (2.0 * DELAY_SHIFT)
    bend = (late - 2.0 * left + early) / (2.0 * DELAY_SHIFT**2)
    moving = (freedom >= LEAST_ROW_FREEDOM) & (left > 0.0)
    usable = moving & (bend > 0.0)
    if not usable.any():
        return RowDelays(0.0, np.inf, np.inf, 1.0, 1.0, 0, int(moving.sum()))
    slope, bend, left, freedom = (x[usable] for x in (slope, bend, left, freedom))
    own = -slope / (2.0 * bend)
    weights = bend * freedom / left
    shares = weights / weights.sum()
    delay = float(shares @ own)
    spread = np.sqrt(shares @ np.square(own - delay) / max(1.0 - shares @ shares, 1e-9))
    after = np.clip((left + slope * delay + bend * delay**2) / left, 1e-3, None)
    noise = np.sum(weights / np.minimum(after, 1.0)) ** -0.5
    std = np.linalg.norm([noise, spread, ROW_ERROR / run.rate])
    typical = [float(np.exp(np.mean(np.log(x)))) for x in (left, after * left)]
    counts = int(usable.sum()), int(moving.sum())
    return RowDelays(delay, float(std), float(spread), typical[0], typical[1], *counts)


def _with_delay(run: Run, delay: float) -> Run:
    """The run with a delay taken out of its efforts, beside what is declared."""
    signals = run.recording.signals
    changed = replace(signals, effort_delay=signals.effort_delay + delay)
    return replace(run, recording=replace(run.recording, signals=changed))


def _squares(information: Information) -> Array:
    """Squares that each row's own least squares leave, and degrees of freedom, `(2, rows)`."""
    found = []
    for row in range(len(information.layout.rows)):
        own, _, left = own_fit(information.row_gram(row))
        found.append((left, float(information.n_samples[row] - own.shape[1])))
    return np.array(found).T


LEAST_ROW_FREEDOM = 20.0  # degrees of freedom that a row needs to say something by itself


def whitened_columns(gram: Array) -> Array:
    """Combinations of columns with unit Gram matrix, shape `(k, rank)`."""
    lengths = np.sqrt(np.maximum(np.diag(gram), 0.0))
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    values, vectors = np.linalg.eigh(gram / lengths[:, None] / lengths)
    kept = values > ROUNDING * values.max()
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]) / lengths[:, None])


def own_fit(gram: Array) -> tuple[Array, Array, float]:
    """Whitened columns of a row's least squares, their products with its effort, square left."""
    own = whitened_columns(gram[:-1, :-1])
    effort = own.T @ gram[:-1, -1]
    return own, effort, float(gram[-1, -1] - effort @ effort)
