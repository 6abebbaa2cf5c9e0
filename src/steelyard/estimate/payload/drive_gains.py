r"""Drive gains from runs with and without a known payload, or from some known gains.

Effort stays on the left as it was logged, $y_j = \rho_j Y_j \phi$ with $\rho_j = 1/k_j$, so its
noise biases nothing; with noisy currents among the columns, gains of weakly moved joints come out
several times too small. $\phi$ is one for all joints and runs, but for friction and offset, which
are each run's own; the payload's mass, known, or a known gain fixes the scale. Friction takes
energy, so its sign in a row is that of the row's gain.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from steelyard.base.arrays import Z95, Array, frozen, json_values
from steelyard.base.errors import DataError, ModelError, refuse_unknown
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.estimate.information.information import Information
from steelyard.estimate.payload.bilinear_least_squares import Bilinear, Solution, solved
from steelyard.estimate.payload.payload_estimate import PayloadEstimate, payload_of
from steelyard.estimate.payload.runs_with_payload import (
    LoadCase,
    carrier,
    load_case,
    refuse_foreign,
)
from steelyard.model.model import Model
from steelyard.robot.robot import Frame, Robot

LARGEST = 0.25
"""Largest relative standard deviation of a gain. The interval is that of its inverse, which is
linear; beyond this, half of the gain, the two differ by more than a quarter."""


class DriveGain(NamedTuple):
    """One joint's gain as it is reported."""

    joint: str
    gain: float
    half_width: float  # half-width of the 95 % interval
    unit: str
    known: bool
    assumed: bool  # whether the data do not show it


@dataclass(frozen=True, eq=False)
class GainEstimate:
    """Drive gains."""

    joints: tuple[str, ...]  # names of the effort rows
    gains: Array  # joint effort per logged unit, `(n,)`
    units: tuple[str, ...]  # their units
    covariance: Array  # `(n, n)`; zero for known gains
    known: tuple[bool, ...]  # whether each was given
    # whether the data do not show it: it is then the geometric mean of the others, and counts for
    # the joint's own friction and rotor only
    assumed: tuple[bool, ...]
    relative: bool  # whether gains, and with them all parameters, are known up to one scale only
    # the payload that fixed the scale, or was found beside, in the scale of the gains; `None`
    # without loaded runs
    payload: PayloadEstimate | None
    sigma: Array  # standard deviation of the filtered residuals per row, in the logged unit

    @property
    def half_width(self) -> Array:
        """Half-widths of the 95 % intervals, shape `(n,)`."""
        return Z95 * np.sqrt(np.diag(self.covariance))

    @property
    def each(self) -> tuple[DriveGain, ...]:
        """The gains one by one."""
        return tuple(
            DriveGain(joint, gain, half, self.units[k], self.known[k], self.assumed[k])
            for k, (joint, gain, half) in enumerate(
                zip(self.joints, self.gains.tolist(), self.half_width.tolist(), strict=True)
            )
        )

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        names = ("joints", "gains", "units", "half_width", "known", "assumed", "relative")
        payload = None if self.payload is None else self.payload.to_dict()
        return {**json_values({name: getattr(self, name) for name in names}), "payload": payload}


def identified_gains(
    model: Model,
    unloaded: Sequence[Information],
    loaded: Sequence[Information] = (),
    *,
    mass: float | None = None,
    frame: str | None = None,
    known: Mapping[str, float] | None = None,
    relative: bool = False,
) -> GainEstimate:
    """Find the drive gains that are not known.

    Given is what runs without and with a payload say, one by one, efforts as logged. The mass of
    the payload [kg] or a known gain fixes the scale; its centre and inertia are found beside the
    gains, in a frame, or that of the last link. Where neither is known, gains `relative` to the
    first joint's, which is called 1, may do. A gain that the data do not show is assumed to be the
    geometric mean of those of its unit; a `DataError` says that there is none, or that nothing
    fixes the scale.
    """
    given = _given(model, known or {})
    unscaled = mass is None and bool(np.isnan(given).all())
    _refuse_unanswerable(unloaded, loaded, mass, unscaled and not relative)
    if unscaled:
        given[0] = 1.0
    refuse_foreign(model, (*unloaded, *loaded))
    carries = carrier(model.robot, frame)
    case = load_case(model, base_parameters(model), carries, unloaded, loaded, first_deviates=False)
    dissipative = frozenset(model.names_where(lambda term: term.dissipation == "each"))
    problem = Bilinear.of(case, mass, given, bool(loaded), dissipative)
    solution = solved(problem)
    pairs = zip(model.robot.effort_units, case.information.signature.effort, strict=True)
    units = tuple("1" if joint == unit else f"{joint}/{unit}" for joint, unit in pairs)
    assumed = np.zeros(len(given), dtype=np.bool_)
    while (shares := problem.deviation(solution)).max(initial=0.0) > LARGEST:
        unseen = problem.wanted[int(np.argmax(shares))]
        assumed[unseen] = True
        problem = replace(problem, given=_assumed(problem, solution, unseen, units))
        solution = solved(problem)
    return GainEstimate(
        joints=model.robot.joint_names,
        gains=frozen(1.0 / solution.rho),
        units=units,
        covariance=frozen(_covariance(problem, solution)),
        known=tuple((~np.isnan(given)).tolist()),
        assumed=tuple(assumed.tolist()),
        relative=unscaled,
        payload=_payload(problem, case, solution, model.robot, carries) if loaded else None,
        sigma=frozen(1.0 / np.sqrt(solution.weights)),
    )


def _covariance(problem: Bilinear, solution: Solution) -> Array:
    """Covariance of all gains; a known one has none."""
    chosen, count = list(problem.wanted), len(problem.free)
    found = problem.covariance(solution)[count:, count:]
    slope = -1.0 / np.square(solution.rho[chosen])
    covariance = np.zeros((problem.n, problem.n))
    covariance[np.ix_(chosen, chosen)] = found * slope[:, None] * slope
    return covariance


def _given(model: Model, known: Mapping[str, float]) -> Array:
    """Known gains in the order of the joints; not a number where unknown."""
    names, given = model.robot.joint_names, np.full(model.robot.n, np.nan)
    for name, gain in known.items():
        where = f"known gains of robot '{model.robot.name}'"
        refuse_unknown(name, names, f"there is no joint '{name}'", where, "joints")
        if not np.isfinite(gain) or gain == 0.0:
            raise ModelError(
                f"the gain of joint '{name}' is {gain:g}",
                where=where,
                fix="give joint effort per logged unit, or leave it out to have it identified",
            )
        given[names.index(name)] = gain
    return given


def _refuse_unanswerable(
    unloaded: Sequence[Information],
    loaded: Sequence[Information],
    mass: float | None,
    unscaled: bool,
) -> None:
    wrong = fix = ""
    if not unloaded and not loaded:
        wrong, fix = "there is no run", "give runs of the robot"
    elif unscaled:
        wrong = "nothing determines the scale: gains are identifiable only relative to each other"
        fix = (
            "give a loaded run with the payload's mass (--loaded LOG --payload-mass KG), or the "
            "gain of one joint"
        )
    elif mass is not None and not (mass > 0.0 and np.isfinite(mass)):
        wrong, fix = f"the payload's mass is {mass:g} kg", "give it in kg"
    elif mass is not None and not (loaded and unloaded):
        lacking = "without" if loaded else "with"
        wrong = f"a known mass needs runs with and without it; there is none {lacking}"
        fix = (
            f"give a run {lacking} the payload, best of the same motion (--loaded LOG for those "
            "with it)"
        )
    if wrong:
        raise DataError(wrong, where="identification of drive gains", fix=fix)


def _assumed(problem: Bilinear, solution: Solution, row: int, units: Sequence[str]) -> Array:
    """The given gains with that of a row: the others' mean, in sign as friction or most are."""
    shares = dict(zip(problem.wanted, problem.deviation(solution), strict=True))
    alike = [
        k
        for k in range(problem.n)
        if k != row and units[k] == units[row] and shares.get(k, 0.0) <= LARGEST
    ]
    if not alike:
        width, joint = 100.0 * Z95 * shares[row], problem.information.layout.rows[row]
        by = f" (95 % interval of ± {width:.0f} %)" if width < 1e4 else ""
        raise DataError(
            f"the data do not determine the gain of joint '{joint}'{by}, nor any "
            "other gain of its unit",
            where="identification of drive gains",
            fix="move it faster, together with the other joints, or give its gain",
        )
    gains = 1.0 / solution.rho[alike]
    sign = problem.signs[row] or (1.0 if np.sum(np.sign(gains)) >= 0.0 else -1.0)
    given = problem.given.copy()
    given[row] = sign * np.exp(np.log(np.abs(gains)).mean())
    return given


def _payload(
    problem: Bilinear, case: LoadCase, solution: Solution, robot: Robot, frame: Frame
) -> PayloadEstimate:
    """The payload, with no uncertainty of a mass that was given."""
    place = {column: k for k, column in enumerate(problem.free)}
    mine = [k for k, column in enumerate(case.payload) if column in place]
    chosen = [place[case.payload[k]] for k in mine]
    covariance = np.zeros((10, 10))
    covariance[np.ix_(mine, mine)] = problem.covariance(solution)[np.ix_(chosen, chosen)]
    return payload_of(
        frame,
        robot,
        solution.theta[list(case.payload)],
        covariance,
        sigma=frozen(1.0 / np.sqrt(solution.weights)),
        n_samples=frozen(case.information.n_samples),
        notes=("the payload's mass was given",) if len(mine) < 10 else (),
    )
