"""Study p1: a leg's model is made smaller by the torque contribution of its parameters [Wang].

The paper identifies a leg of two joints with 12 parameters. It designs a motion for the condition
number of the regressor, runs it, identifies, removes the parameter that contributes least to the
torques, designs the next motion for those that are left, and so on; four parameters go. On a circle
of the foot the reduced model predicts better than the full one, and than the full one from a better
motion.

    python studies/p1_reduction.py -o DIR [--quick] [--seeds N]

For every seed another leg, whose parameters no estimator sees, goes through the whole loop. Models
are then identified five times each, from as much data each, and predict the circle. The paper's
models are least squares exactly as printed (eqs. 4, 5 and 12): without parallel filter and joint
weights, and with the samples at rest.
"""

import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.append(str(Path(__file__).parents[1]))
from studies.support.measured import (
    HEADING,
    UR10E_PROCESS,
    UR10E_RUNS,
    errors_on,
    example,
    log,
    percent_table,
    ur10e,
)
from studies.support.measured import Errors as ErrorsOnLog
from studies.support.page import Claim, Page, Part, Section, Table, Text, over_seeds
from studies.support.picture import Curve, Panel, Picture
from studies.support.robots import TORQUE, robot_file
from studies.support.study import Study, run

import steelyard

Array = NDArray[np.float64]

STEP, PERIODS, PERIOD = 0.03, 10, 10.0
"""Distance of recorded points [s]; periods that are used, of 12 in the paper, and their length."""

NOISE, CORRELATED = np.array([0.41, 0.18]), 1.0
"""Noise of the torques of hip and knee [Nm], of the size of the errors of table II, and the time
over which it is correlated [s]."""

REMOVED, REPEATS, SEARCHES = 4, 5, 3
"""Parameters that the paper removes, its repeated estimations, and searches of each design of the
loop; 1, 2 and 1 in the quick form. The better motion for the full model gets as many searches as
all designs of the loop together."""

MOVING = 0.02
"""Speed of both joints above which they count as moving on the circle [rad/s]."""

CALIBRATED = """
[estimation]
effort_scales = "off"
"""
"""The torque sensors are calibrated; scales of the torques would be estimated with the masses."""

PAPER = f"""
[estimation]
method = "least_squares"
weights = "equal"
[processing]
matched_cutoff = "off"
rest_speed = "off"
outliers = "keep"
saturation = "keep"
rate = {1.0 / STEP}
motion = {{ method = "moving_average", span = 5 }}
effort = {{ method = "moving_average", span = 9 }}
"""
"""Least squares as printed; central differences, accelerations averaged over 5 points and torques
over 9."""

CIRCLE = """
[excitation.motion]
kind = "circle"
centre = [0.5, -0.51, 0.0]
radius = 0.05
period = 5.0
laps = 4
normal = [0.0, 0.0, 1.0]
start = [-0.35, -0.9]
[excitation.workspace]
point = [0.4, 0.0, 0.0]
"""
"""The foot's circle, for validation."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """What the simulated leg did along one period of a motion, without noise.

    Attributes:
        q: Positions every 10 ms, shape `(N, 2)` [rad].
        tau: Torques, likewise [Nm].
    """

    q: Array
    tau: Array

    def write(self, log: Path, random: np.random.Generator, periods: int = PERIODS) -> None:
        """Write a log of some periods with encoders of 17 bits and noise of the torques."""
        every = round(STEP / 0.01)
        q, tau = (np.tile(x, (periods, 1))[::every] for x in (self.q, self.tau))
        bit = 2.0 * np.pi / 2**17
        rows = np.column_stack(
            [STEP * np.arange(len(q)), np.round(q / bit) * bit, tau + drifting(len(q), random)]
        )
        header = "time_s,q1_rad,q2_rad,tau1_Nm,tau2_Nm"
        np.savetxt(log, rows, delimiter=",", header=header, comments="", fmt="%.9g")


def drifting(count: int, random: np.random.Generator) -> Array:
    """Slowly varying noise of both torques, shape `(count, 2)` [Nm]."""
    values, share = random.normal(size=(count, 2)), np.exp(-STEP / CORRELATED)
    for k in range(1, count):
        values[k] = share * values[k - 1] + np.sqrt(1.0 - share**2) * values[k]
    return np.asarray(NOISE * values)


class SimulatedLeg:
    """A leg that runs motions and logs them: what `reduction_loop` asks of a robot's driver."""

    def __init__(self, robot: Path, work: Path, seed: int) -> None:
        """Same seed, same leg and noise."""
        self._robot, self._work, self._seed = robot, work, seed
        self._random = np.random.default_rng([seed, 1])
        self._known: dict[str, Recorded] = {}

    def send(self, trajectory: steelyard.Trajectory) -> None:
        """The motion is run when its log is complete."""

    @contextmanager
    def record(self, log: Path) -> Iterator[None]:
        """Run the motion that the loop has put beside the log."""
        yield
        self.along(log.parent / "motion" / "trajectory.json").write(log, self._random)

    def along(self, motion: Path) -> Recorded:
        """Run a motion once, which begins and ends at rest; without the rests around it."""
        text = motion.read_text(encoding="utf-8")
        if text not in self._known:
            folder = self._work / f"run_{len(self._known):02d}"
            steelyard.simulate(self._robot, folder, motion, noise=0.0, rate=100.0, seed=self._seed)
            names = ["time_s", "q1_rad", "q2_rad", "tau1_Nm", "tau2_Nm"]
            rows = np.genfromtxt(folder / "log.csv", delimiter=",", names=True)
            table = np.column_stack([rows[name] for name in names])
            one = table[(table[:, 0] > 0.995) & (table[:, 0] < table[-1, 0] - 1.005)]
            self._known[text] = Recorded(one[:, 1:3], one[:, 3:5])
        return self._known[text]


MODELS = (
    "full",
    "full, better motion",
    "reduced",
    "ours",
    "ours, reduced",
)
"""The paper's three, the consistent estimate of the full model, and the default reduction of it;
ours from the logs of the better motion."""

PRINTED = MODELS[:3]
"""The paper's: PDM, ODM and SDM."""

FITTED = MODELS[:4]
"""Those whose errors on their own excitation motion are compared."""

SHOWN = ("full", "reduced", "full, better motion")
"""Models whose motions are shown, in the order of the paper's figures."""

Errors = dict[str, Array]
"""By model: per repeated estimation the root mean square errors of hip and knee [Nm], and both
together relative to the torques [%], shape `(repeats, 3)`."""


@dataclass(frozen=True, eq=False)
class Found:
    """What one seed gave.

    Attributes:
        conditions: Condition number by round.
        removed: Parameters in the order of their removal.
        shares: Their relative contributions before their removal, eq. 7.
        first: Relative contribution of every parameter in the first round, by name.
        better: Condition number of the better motion for the full model.
        names: Parameters of the reduced model.
        units: Their units.
        estimates: Their repeated estimates, shape `(repeats, p)`.
        consistent: Those of ours, of the full model, likewise.
        truth: Their true values, which nothing but this comparison sees.
        fitted: Errors on the excitation motion, against measured torques.
        measured: Errors on the circle against measured torques.
        true: Errors on the circle against torques without noise, where both joints move.
        motions: Positions of the first, the last and the better motion and of the circle, `(N, 2)`
            each.
        reconstructed: Torques of one period of the last motion, measured and of the reduced model.
        torques: Measured on the circle, and predicted by the models of `FITTED`.
    """

    conditions: tuple[float, ...]
    removed: tuple[str, ...]
    shares: tuple[float, ...]
    first: dict[str, float]
    better: float
    names: tuple[str, ...]
    units: tuple[str, ...]
    estimates: Array
    consistent: Array
    truth: Array
    fitted: Errors
    measured: Errors
    true: Errors
    motions: tuple[Array, ...]
    reconstructed: tuple[Array, Array]
    torques: tuple[Array, ...]


def one(folder: Path, seed: int, quick: bool) -> Found:
    """The loop, repeated estimations of each model, and the circle."""
    removed, repeats, searches = (1, 2, 1) if quick else (REMOVED, REPEATS, SEARCHES)
    leg = robot_file("p1_leg", folder / "leg.toml", TORQUE + PAPER)
    ours = robot_file("p1_leg", folder / "ours.toml", TORQUE + CALIBRATED)
    designed = steelyard.design_excitation(
        leg, budget=300.0, searches=(removed + 1) * searches, processes=1, seed=seed + 100
    )
    better = designed.save(folder / "better_motion") / "trajectory.json"
    planned = steelyard.design_excitation(robot_file("p1_leg", folder / "circle.toml", CIRCLE))
    circle = planned.save(folder / "circle") / "trajectory.json"

    rig = SimulatedLeg(leg, folder, seed)
    rounds = steelyard.reduction_loop(
        leg,
        rig,
        folder / "loop",
        limit=1.0,  # the paper's loop does not reach its own limit of 100 either
        rounds=removed + 1,
        budget=300.0,
        searches=searches,
        processes=1,
        seed=seed,
        check=False,
    )
    first, last = rounds[0], rounds[-1]
    contributions = steelyard.reduce(
        first.model,
        first.folder / "log.csv",
        criterion="contribution",
        stop="one_fewer",
        weights="equal",
        threads=1,
    ).criterion_table
    random = np.random.default_rng([seed, 2])
    recorded = {
        "full": rig.along(first.folder / "motion" / "trajectory.json"),
        "full, better motion": rig.along(better),
        "reduced": rig.along(last.folder / "motion" / "trajectory.json"),
    }
    test = rig.along(circle)
    names = steelyard.base_parameters(steelyard.model_of(leg)).base_names
    kept = tuple(name for name in names if name not in last.removed)

    predictions: dict[str, list[Array]] = {name: [] for name in MODELS}
    fits: dict[str, list[Array]] = {name: [] for name in FITTED}
    estimates, models, reconstructed = [], [], []
    motion, clean, noisy, moving = validation(leg, folder, test, random)
    for repeat in range(repeats):
        for name, run_of in recorded.items():
            log = folder / f"{name.replace(', ', '_').replace(' ', '_')}_{repeat}.csv"
            run_of.write(log, random)
            left = kept if name == "reduced" else names
            values = least_squares(leg, log, left)
            predictions[name].append(predicted(leg, left, values, motion))
            data = steelyard.load_runs(leg, log)[0].whole()
            found = predicted(leg, left, values, data.motion)
            fits[name].append(relative(found, data.effort))
            if name == "reduced":
                estimates.append(values)
                rows = slice(round(PERIOD / STEP))
                reconstructed.append((data.effort[rows], found[rows]))
            if name == "full, better motion":
                model = steelyard.identify(ours, log, check=False, threads=1).model
                smaller = steelyard.reduce(model, log, threads=1).model
                models.append(model.estimate.parameters)
                fits["ours"].append(relative(model.torque(data.motion), data.effort))
                predictions["ours"].append(model.torque(motion))
                predictions["ours, reduced"].append(smaller.torque(motion))
    return Found(
        tuple(r.condition for r in rounds),
        last.removed,
        tuple(one.worth for one in last.model.estimate.removed if one.worth is not None),
        dict(zip(contributions["name"], contributions["before"], strict=True)),
        designed.to_dict()["condition"],
        kept,
        units(leg, kept),
        np.array(estimates),
        np.array([[found[name] for name in kept] for found in models]),
        truth(leg, folder / "run_00" / "truth.json", kept),
        {name: np.array(rows) for name, rows in fits.items()},
        {name: errors(found, noisy) for name, found in predictions.items()},
        {
            name: errors([torque[moving] for torque in found], clean[moving])
            for name, found in predictions.items()
        },
        tuple(run_of.q for run_of in (*(recorded[name] for name in SHOWN), test)),
        reconstructed[0],
        (noisy, *(predictions[name][0] for name in FITTED)),
    )


def least_squares(robot: Path, log: Path, names: Sequence[str]) -> Array:
    """Least squares of some base parameters, the others zero, eq. 12.

    Args:
        robot: The robot file.
        log: The log.
        names: Parameters to estimate, `p` of them.

    Returns:
        Their values, shape `(p,)`.
    """
    model = steelyard.model_of(robot)
    sums = steelyard.information(model, steelyard.load_runs(robot, log), threads=1)
    products, right, _ = sums.select(names).normal()
    return np.asarray(np.linalg.solve(products, right), dtype=np.float64)


def predicted(robot: Path, names: Sequence[str], values: Array, motion: steelyard.Motion) -> Array:
    """Torques of some base parameters along a motion, shape `(N, 2)` [Nm]."""
    model = steelyard.model_of(robot)
    nominal, base = model.prior, steelyard.base_parameters(model)
    assert nominal is not None  # the robot file gives all masses
    columns = [base.independent[base.base_names.index(name)] for name in names]
    return nominal.regressor(motion)[:, :, columns] @ values


def relative(found: Array, wanted: Array) -> Array:
    """Root mean square error of each joint, eq. 15 [Nm], and eq. 16 over both [%]."""
    rest = found - wanted
    share = 100.0 * np.linalg.norm(rest) / np.linalg.norm(wanted)
    return np.array([*np.sqrt(np.mean(rest**2, axis=0)), share])


def errors(found: Sequence[Array], wanted: Array) -> Array:
    """`relative` of each repeated estimation, shape `(repeats, 3)`."""
    return np.array([relative(one, wanted) for one in found])


def validation(
    robot: Path, folder: Path, test: Recorded, random: np.random.Generator
) -> tuple[steelyard.Motion, Array, Array, NDArray[np.bool_]]:
    """The circle as it is recorded: motion, torques without and with noise, where both move."""
    log = folder / "circle.csv"
    test.write(log, random, periods=1)
    (run_of,) = steelyard.load_runs(robot, log)
    data = run_of.whole()
    times = 0.01 * np.arange(len(test.tau))
    clean = np.column_stack([np.interp(data.t, times, column) for column in test.tau.T])
    speeds = np.abs(np.gradient(test.q, 0.01, axis=0)).min(axis=1)
    return data.motion, clean, data.effort, np.interp(data.t, times, speeds) > MOVING


def truth(robot: Path, file: Path, names: Sequence[str]) -> Array:
    """True values of base parameters, shape `(p,)`."""
    values = json.loads(file.read_text(encoding="utf-8"))["parameters"]
    base = steelyard.base_parameters(steelyard.model_of(robot))
    every = base.base_values([values[name]["value"] for name in base.names])
    return every[[base.base_names.index(name) for name in names]]


def units(robot: Path, names: Sequence[str]) -> tuple[str, ...]:
    """Units of base parameters."""
    base = steelyard.base_parameters(steelyard.model_of(robot))
    return tuple(base.base_units[base.base_names.index(name)] for name in names)


TABLE_1 = {
    "p2 [Nm]": (13.8238, 14.0202, 13.7847, 13.8903, 13.8968, 0.5783),
    "p4 [kg m²]": (0.9722, 0.9721, 0.9725, 0.9722, 0.9722, 0.0144),
    "p5 [kg m²]": (0.0120, 0.0122, 0.0119, 0.0120, 0.0117, 1.4498),
    "p6 [Nm]": (-2.3991, -2.2644, -2.4859, -2.4584, -2.4552, 3.2857),
    "p7 [Nm]": (0.5071, 0.4829, 0.4715, 0.4430, 0.4632, 4.4917),
    "p8 [kg m²]": (43.9145, 40.8640, 45.6607, 38.2915, 41.7885, 6.0180),
    "p9 [kg m²]": (38.6113, 31.2062, 38.5468, 28.1294, 33.0645, 12.1614),
    "p11 [Nm]": (0.2772, 0.2668, 0.2750, 0.2751, 0.2739, 1.3063),
}
"""Table I of the paper: five estimations, and the printed relative standard deviation [%]."""


def page(found: Sequence[Found]) -> Page:
    """Tables, pictures and bounds."""
    bounds = (
        ("default reduction minus full model", "ours, reduced", "full"),
        ("default reduction minus full model from the same logs", "ours, reduced", MODELS[1]),
        ("consistent estimate minus full model from the same logs", "ours", MODELS[1]),
    )
    gaps = [(name, *difference(found, one, other, "true")) for name, one, other in bounds]
    claims = tuple(
        Claim(
            f"{name}, true torques of the circle",
            f"{gap:+.3f} ± {error:.3f} %",
            "<= one standard error",
            gap <= error,
        )
        for name, gap, error in gaps
    )
    parts: tuple[Part, ...] = (
        verdicts(found),
        story(len(found[0].conditions)),
        rounds_table(found),
        condition_picture(found),
        contributions_table(found[0]),
        printed_table(),
        *estimates_tables(found[0]),
        fitted_table(found),
        *(circle_table(found, kind) for kind in ("measured", "true")),
        motion_picture(found[0]),
        reconstruction_picture(found[0]),
        torque_picture(found[0]),
    )
    return Page("Reduction by relative torque contribution", parts, claims)


def difference(found: Sequence[Found], one: str, other: str, kind: str) -> tuple[float, float]:
    """Mean difference of two models' errors on the circle, and its standard error [%].

    Args:
        found: The seeds; of a single one, the standard error is over repeated estimations.
        one: Name of a model.
        other: The model whose error is subtracted.
        kind: `true` or `measured`, what the errors are of.
    """
    rows = [getattr(f, kind)[one][:, 2] - getattr(f, kind)[other][:, 2] for f in found]
    gaps = rows[0] if len(rows) == 1 else np.mean(rows, axis=1)
    return float(np.mean(gaps)), float(np.std(gaps, ddof=1) / np.sqrt(len(gaps)))


def verdicts(found: Sequence[Found]) -> Table:
    """What the paper claims, and whether it holds here."""
    steps = np.array([np.diff(one.conditions) for one in found])
    falls = int(np.sum(np.all(steps < 0.0, axis=1)))
    below = int(np.sum([one.conditions[-1] < one.better for one in found]))
    own = float(np.median(medians(found, "fitted", "reduced", 2)))
    spreads = 100.0 * np.array([relative_deviations(one.estimates).max() for one in found])
    scattered = int(np.sum(spreads <= 12.1614))
    full, better, reduced = (
        float(np.median(medians(found, "measured", name, 2))) for name in PRINTED
    )
    seeds = len(found)

    def compared(one: str, other: str, kind: str) -> tuple[str, str]:
        gap, error = difference(found, one, other, kind)
        holds = "partly" if abs(gap) <= error else "yes" if gap < 0.0 else "no"
        words = f"{one} minus {other}: {gap:+.3f} ± {error:.3f} % of the torques"
        return holds, f"{words}{' (not significant)' if holds == 'partly' else ''}"

    def counted(number: int, words: str) -> tuple[str, str]:
        holds = "yes" if number == seeds else "partly" if number else "no"
        return holds, f"{words} in {number} of {seeds} seeds"

    medians_here = f"median errors {reduced:.3g}, {better:.3g} and {full:.3g} %"
    rows = (
        (
            "the condition number falls with every removal (fig. 3)",
            *counted(falls, "falls at every step"),
        ),
        (
            "removal reduces it further than a better search for the full model (ROA) can",
            *counted(below, "below that of the full model with the better motion"),
        ),
        (
            "the reduced model describes the leg: 1.01 % on its own motion (table II)",
            "yes" if own <= 1.01 else "partly" if own <= 2.02 else "no",
            f"{own:.3g} % in the median",
        ),
        (
            "five estimations scatter by at most 12 % (table I)",
            *counted(scattered, "all parameters do so"),
        ),
        (
            "on the circle the reduced model predicts better than the full one: 1.56 against "
            "2.95 % (table III)",
            *compared("reduced", "full", "measured"),
        ),
        (
            "and slightly better than the full one from a better motion: 1.85 %",
            *compared("reduced", "full, better motion", "measured"),
        ),
        (
            "a better motion alone makes the full model better: 1.85 against 2.95 %",
            *compared("full, better motion", "full", "measured"),
        ),
        (
            "neglecting the parameters of least contribution improves the model: against true "
            "torques, which the paper cannot have",
            *compared("reduced", "full", "true"),
        ),
    )
    title = f"What the paper claims, and whether it holds here ({medians_here} on the circle)"
    return Table(title, rows, ("the paper", "holds here", "figure"))


def story(rounds: int) -> Text:
    """What is replayed, assumed and different.

    Args:
        rounds: Designs of the loop.
    """
    return Text(
        "",
        (
            "Wang et al. reduce the model of a rehabilitation robot's leg: after each motion the "
            "parameter with the smallest relative contribution to the torques goes, and a motion "
            "for the others is designed. Here a simulated leg takes its place, for every seed one "
            "with other masses and friction; no estimator sees them, nor the masses of the robot "
            "file.",
            "The models full, full with better motion, and reduced are the paper's PDM, ODM and "
            "SDM: least squares exactly as eqs. 4, 5 and 12 print it, without joint weights and "
            "filters of the regressor, and with the samples at which joints stand still. The "
            f"better motion stands for the search of the paper's reference 2 (ROA) and has as many "
            f"searches as all {rounds} designs of the loop together.",
            "Assumed, as the paper does not print it: thigh 0.42 m, shank 0.40 m, masses, limits "
            "of positions, speeds (0.4 and 0.5 rad/s) and accelerations (0.5 and 0.6 rad/s²), "
            "period 10 s, five harmonics, a circle of 0.05 m in 5 s (studies/robots/p1_leg.toml). "
            "The noise of the torques is of the size of the errors of table II and correlated "
            "over 1 s. Ten periods at 30 ms are used (one is simulated, as each begins and ends at "
            "rest; each has noise of its own), torques averaged over 9 points and "
            "accelerations over 5, as in the paper. The parameters are base parameters of our own "
            "choice, so that only their number, not their values, compares with that of p1 to p12.",
            "Errors of the paper. Eq. 14 divides by 5, while the values of table I are population "
            "standard deviations (division by √5): both are below. The torques pass a mean over "
            "270 ms, the columns of the regressor do not: at 1 Hz the torques are 11 % too low. "
            "The loop is to end at a condition number of 100 and is ended at 503.4; here it is "
            "ended after as many removals, whatever the condition number.",
            "The condition number cannot rise from round to round: a motion that is no better than "
            "the last one is not taken. That it falls is no merit of the criterion, as fewer "
            "columns of the same motion never have a larger one.",
            "Ours is the consistent estimate of the full model (valid bodies, friction >= 0, "
            "joints weighted, smoothing chosen from the data) from the logs of the better motion; "
            "the default reduction of it removes what is not significant on left-out data.",
            "Measured torques of the circle contain noise, and reversals of the slow joints, where "
            "friction changes its sign and averaging lowers it. The last table leaves out both: "
            f"torques without noise, where both joints are faster than {MOVING:g} rad/s.",
        ),
    )


def rounds_table(found: Sequence[Found]) -> Table:
    """Condition numbers and what is removed."""
    rows = [
        (
            f"condition number after {k} removals",
            "503.4" if k == REMOVED else "fig. 3, no number",
            over_seeds([one.conditions[k] for one in found]),
            "–",
        )
        for k in range(len(found[0].conditions))
    ]
    better = over_seeds([one.better for one in found])
    order = ", ".join(
        f"{name} ({100.0 * share:.2g} %)"
        for name, share in zip(found[0].removed, found[0].shares, strict=True)
    )
    return Table(
        "The loop (fig. 3)",
        (
            *rows,
            ("full model, better motion", "not printed", better, better),
            (
                "removed, in this order, with the relative contribution before (first seed)",
                "p1, p3, p10, p12",
                order,
                "–",
            ),
        ),
    )


def contributions_table(first: Found) -> Table:
    """Eqs. 6 to 9 for the full model."""
    order = sorted(first.first, key=first.first.__getitem__)
    rows = tuple((name, f"{100.0 * first.first[name]:.3g}") for name in order)
    title = "Relative torque contributions of the full model (eqs. 6 to 9), first seed"
    return Table(title, rows, ("", "the paper's method here [%]"))


def printed_table() -> Table:
    """Spread of the paper's table I, by both formulas."""
    rows = []
    for name, (*values, printed) in TABLE_1.items():
        population = 100.0 * np.std(values) / abs(np.mean(values))
        cells = f"{np.mean(values):.4f}", f"{printed:.4f}", f"{population:.4f}"
        rows.append((name, *cells, f"{population / np.sqrt(5.0):.4f}"))
    columns = ("", "mean", "printed [%]", "population std [%]", "eq. 14 as printed [%]")
    return Table("The paper's table I, corrected", tuple(rows), columns)


def estimates_tables(first: Found) -> tuple[Table, Table]:
    """Table I here, and the same parameters of ours."""
    labels = [f"{name} [{unit}]" for name, unit in zip(first.names, first.units, strict=True)]
    deviations = relative_deviations(first.estimates)
    rows = tuple(
        (
            label,
            *(f"{value:.4f}" for value in values),
            f"{np.mean(values):.4f}",
            f"{100.0 * share:.4f}",
            f"{100.0 * share / np.sqrt(len(values)):.4f}",
            f"{true:.4f}",
        )
        for label, values, share, true in zip(
            labels, first.estimates.T, deviations, first.truth, strict=True
        )
    )
    numbers = (str(k + 1) for k in range(len(first.estimates)))
    columns = (
        *("", *numbers, "mean (eq. 13)"),
        *("population std [%]", "eq. 14 as printed [%]", "true value"),
    )
    mine = tuple(
        (label, f"{np.mean(values):.4f}", f"{100.0 * share:.4f}", f"{true:.4f}")
        for label, values, share, true in zip(
            labels,
            first.consistent.T,
            relative_deviations(first.consistent),
            first.truth,
            strict=True,
        )
    )
    return (
        Table("Table I here: the reduced model, first seed", rows, columns),
        Table(
            "The same parameters of ours, the full model",
            mine,
            ("", "mean", "population std [%]", "true value"),
        ),
    )


def relative_deviations(estimates: Array) -> Array:
    """Population standard deviation over the size of the mean, shape `(p,)`, as in table I."""
    return np.asarray(estimates.std(axis=0) / np.abs(estimates.mean(axis=0)))


def fitted_table(found: Sequence[Found]) -> Table:
    """Table II."""
    rows = tuple(
        (label, paper, *(over_seeds(medians(found, "fitted", name, k)) for name in FITTED))
        for k, (label, paper) in enumerate(
            (("hip [Nm]", "0.4089"), ("knee [Nm]", "0.1841"), ("both [%]", "1.01"))
        )
    )
    columns = ("", "paper, reduced", *FITTED)
    return Table("Table II: errors on the excitation motion", rows, columns)


def circle_table(found: Sequence[Found], kind: str) -> Table:
    """Table III."""
    paper = (("0.4487", "0.4182", "0.37"), ("0.7666", "0.3672", "0.288"), ("2.95", "1.85", "1.56"))
    rows: list[tuple[str, ...]] = []
    for k, label in enumerate(("hip [Nm]", "knee [Nm]", "both [%]")):
        if kind == "measured":
            rows.append((f"paper: {label}", *paper[k], "–", "–"))
        rows.append((label, *(over_seeds(medians(found, kind, name, k)) for name in MODELS)))
    against = {
        "measured": "Table III: errors on the circle against measured torques, eqs. 15 and 16",
        "true": "The same against the torques without noise, where both joints move",
    }
    return Table(against[kind], tuple(rows), ("", *MODELS))


def medians(found: Sequence[Found], kind: str, name: str, column: int) -> list[float]:
    """Per seed the median over the repeated estimations."""
    return [float(np.median(getattr(one, kind)[name][:, column])) for one in found]


def condition_picture(found: Sequence[Found]) -> Picture:
    """Fig. 3."""
    curves = tuple(Curve("", range(len(one.conditions)), one.conditions, colour=0) for one in found)
    ticks = tuple(str(k) for k in range(len(found[0].conditions)))
    panel = Panel("Condition number", "parameters removed", "", curves, ticks=ticks)
    caption = "The condition number over the rounds of the loop, one line per seed (fig. 3)."
    return Picture("condition", caption, (panel,), columns=1)


def motion_picture(first: Found) -> Picture:
    """Figs. 2, 4, 6 and 7a."""
    titles = (
        "full model (fig. 2)",
        "reduced model (fig. 4)",
        "full model, better motion (fig. 6)",
        "circle (fig. 7a)",
    )
    panels = tuple(
        joints_panel(title, "rad", 0.01, (("", q),))
        for title, q in zip(titles, first.motions, strict=True)
    )
    return Picture("motions", "Joint angles along one period, first seed.", panels)


def reconstruction_picture(first: Found) -> Picture:
    """Fig. 5."""
    series = tuple(zip(("measured", "reconstructed"), first.reconstructed, strict=True))
    panels = tuple(
        joints_panel(f"{joint}", "Nm", STEP, series, k) for k, joint in enumerate(("hip", "knee"))
    )
    caption = "Measured and reconstructed torques of the reduced model on its own motion, one "
    return Picture("reconstruction", f"{caption}period of the first seed (fig. 5).", panels)


def torque_picture(first: Found) -> Picture:
    """Fig. 7b to d, and ours."""
    letters = dict(zip(PRINTED, "bcd", strict=True))
    panels = tuple(
        joints_panel(
            f"{name}: {joint}" + (f" (fig. 7{letters[name]})" if name in letters else ""),
            "Nm",
            STEP,
            (("measured", first.torques[0]), ("estimated", tau)),
            k,
        )
        for name, tau in zip(FITTED, first.torques[1:], strict=True)
        for k, joint in enumerate(("hip", "knee"))
    )
    caption = "Torques on the circle of the first seed, measured and estimated (fig. 7)."
    return Picture("torques", caption, panels)


def joints_panel(
    title: str,
    unit: str,
    step: float,
    series: Sequence[tuple[str, Array]],
    joint: int | None = None,
) -> Panel:
    """Series `(N, 2)` over time: those of one joint by their names, or one of both joints."""
    curves = [
        (name or ("hip", "knee")[k], values[:, k])
        for name, values in series
        for k in ((0, 1) if joint is None else (joint,))
    ]
    drawn = tuple(Curve(name, step * np.arange(len(values)), values) for name, values in curves)
    return Panel(title, "time [s]", unit, drawn)


UR10E = """
[estimation]
method = "least_squares"
weights = "equal"
[processing]
matched_cutoff = "off"
outliers = "keep"
saturation = "keep"
motion = { method = "moving_average", span = 5 }
effort = { method = "moving_average", span = 9 }
"""
"""The paper's method on a measured robot, with samples at standstill left out."""

REPEATED = (
    "ur-19_09_27-11_28_22",
    "ur-19_09_27-15_11_06",
    "ur-19_10_01-13_51_41",
    "ur-19_10_01-14_04_13",
    "ur-19_10_01-14_04_41",
)
"""Logs of the UR10e that run the same motion of 5 s."""

SHARE = 4.0 / 12.0
"""Parameters that are removed, relative to all, as in the paper."""

MOST_SCATTER = 12.1614
"""Greatest relative deviation in table I [%]."""


@dataclass(frozen=True)
class OnRobot:
    """What was found from some logs of the UR10e.

    Attributes:
        name: The logs.
        sizes: Parameters of the full model, of the reduced one and of the default reduction.
        conditions: Condition number before and after the removal, columns of unit length.
        removed: Largest relative torque contribution that was removed, eqs. 6 to 9.
        scatter: Relative standard deviation of each parameter of the reduced model over
            estimations from each log alone, shape `(p,)` [%].
        fitted: Errors on the first fitted log, by model.
        unseen: On a motion that nothing was fitted to, likewise.
    """

    name: str
    sizes: tuple[int, int, int]
    conditions: tuple[float, float]
    removed: float
    scatter: Array
    fitted: dict[str, ErrorsOnLog]
    unseen: dict[str, ErrorsOnLog]

    def over(self, one: str, other: str) -> float:
        """Error of one model over that of another, unseen motion, all joints."""
        return self.unseen[one].percent[-1] / self.unseen[other].percent[-1]


def measured(folder: Path, quick: bool) -> Section:
    """Reduction by contribution from logs of a UR10e."""
    paper, ours = (
        example("ur10e", folder / f"{name}.toml", tables)
        for name, tables in (("paper", UR10E), ("ours", ""))
    )
    cases = {
        "one motion of 5 s run five times": REPEATED,
        "seven motions of 20 to 50 s": UR10E_RUNS,
    }
    found = tuple(
        on_robot(name, paper, ours, ur10e(*names))
        for name, names in list(cases.items())[: 1 if quick else None]
    )
    tables = (
        percent_table(f"UR10e, {one.name}: error from point to point", one.unseen) for one in found
    )
    text = Text(HEADING, ON_ROBOT)
    return Section((text, robot_verdicts(found), robot_table(found), *tables), robot_claims(found))


def on_robot(name: str, paper: Path, ours: Path, logs: list[str]) -> OnRobot:
    """Reduce the UR10e's model from some logs, and predict another motion."""
    full, default = (
        steelyard.identify(file, logs, check=False, threads=1).model for file in (paper, ours)
    )
    count = len(full.estimate.parameters.names)
    smaller = steelyard.reduce(
        full,
        logs,
        criterion="contribution",
        stop=f"count={round((1.0 - SHARE) * count)}",
        weights="equal",
        each=True,
        threads=1,
    )
    own = steelyard.reduce(default, logs, threads=1)
    models = {
        "full": full,
        "reduced by contribution": smaller.model,
        "ours": default,
        "ours, reduced": own.model,
    }
    assert smaller.repeated is not None  # as each log is estimated alone
    scatter = smaller.repeated.table["relative_percent"].to_numpy()
    path, last = smaller.reduction.path, smaller.reduction.state
    gone = smaller.criterion_table.drop_nulls("step")["last"].to_numpy()
    return OnRobot(
        name,
        (count, len(smaller.kept), len(own.kept)),
        (path.states[0].condition, last.condition),
        float(gone.max()),
        scatter,
        errors_on(models, logs[0], like="ours"),
        errors_on(models, log(UR10E_PROCESS), like="ours"),
    )


ON_ROBOT = (
    "UR10e, motor currents times published gains: from one motion of 5 s that is run five times on "
    "two days, and from seven Fourier motions of 20 to 50 s. Unseen is the motion from point to "
    "point through ten postures.",
    "The paper's method: least squares with equal weights, no filter of the regressor, moving "
    "averages over 5 and 9 points of the log (of 10 ms), removal by relative torque contribution "
    "until a third of the parameters is gone, as in the paper. Different from the paper: the robot "
    "does not run a new motion after each removal, and samples at standstill, whose currents "
    "friction determines, are left out. Ours: the consistent estimate, and the default reduction "
    "from the same logs, which finds its size by leaving logs out. All models are compared on the "
    "same signals, those of ours. A reduced model describes motions like those of its logs: the "
    "motion from point to point has other postures than the motion of 5 s.",
)


def robot_verdicts(found: Sequence[OnRobot]) -> Table:
    """The paper's claims on the UR10e."""
    paper = "reduced by contribution"

    def each(values: Sequence[float], unit: str = "") -> str:
        return "; ".join(f"{one.name} {x:.3g}{unit}" for one, x in zip(found, values, strict=True))

    def holds(true: Sequence[bool]) -> str:
        return "yes" if all(true) else "partly" if any(true) else "no"

    better = [one.over(paper, "full") for one in found]
    consistent = [one.over(paper, "ours") for one in found]
    own = [one.over("ours, reduced", "full") for one in found]
    scatter = found[0].scatter  # of the same motion, as in the paper
    rows = (
        (
            "five estimations scatter by at most 12 % (table I)",
            holds((scatter <= MOST_SCATTER).tolist()),
            f"{np.sum(scatter <= MOST_SCATTER)} of {len(scatter)} parameters of the reduced model "
            f"do; median {np.nanmedian(scatter):.3g} %",
        ),
        (
            "the reduced model predicts another motion better than the full one (table III)",
            holds([x < 1.0 for x in better]),
            f"its error over that of the full model: {each(better)}; over that of the consistent "
            f"estimate: {each(consistent)}",
        ),
        (
            "the reduced model is accurate: 1.56 % on another motion (table III)",
            holds([one.unseen[paper].percent[-1] <= 1.56 for one in found]),
            f"error: {each([one.unseen[paper].percent[-1] for one in found], ' %')}",
        ),
        (
            "(ours) the default reduction predicts another motion as well as the full model",
            holds([x <= 1.05 for x in own]),
            f"its error over that of the full model: {each(own)}",
        ),
    )
    columns = ("the paper", "holds there", "figure")
    return Table("What the paper claims, and whether it holds on a measured robot", rows, columns)


def robot_table(found: Sequence[OnRobot]) -> Table:
    """Sizes, condition numbers and contributions."""
    rows = []
    for one in found:
        full, small, own = (f"{size}" for size in one.sizes)
        before, after = (f"{condition:.3g}" for condition in one.conditions)
        names = list(one.unseen)
        rows += [
            (f"{one.name}: parameters", full, small, "–", own),
            (f"{one.name}: condition number", before, after, "–", "–"),
            (f"{one.name}: largest contribution removed [%]", "–", f"{100.0 * one.removed:.3g}",
             "–", "–"),
            (f"{one.name}: error on a fitted log, all joints [%]",
             *(f"{one.fitted[name].percent[-1]:.3g}" for name in names)),
            (f"{one.name}: error from point to point, all joints [%]",
             *(f"{one.unseen[name].percent[-1]:.3g}" for name in names)),
        ]  # fmt: skip
    columns = ("", "full", "reduced by contribution", "ours", "ours, reduced")
    return Table("Reduction on the UR10e", tuple(rows), columns)


def robot_claims(found: Sequence[OnRobot]) -> tuple[Claim, ...]:
    """Bounds of the UR10e; a motion of 5 s shows too little of what another one needs."""
    return tuple(
        Claim(
            f"measured UR10e, {one.name}: error of the default reduction over that of the full "
            "model, unseen motion",
            f"{one.over('ours, reduced', 'full'):.3g}",
            "<= 1.05",
            one.over("ours, reduced", "full") <= 1.05,
        )
        for one in found[1:]
    )


STUDY = Study("p1", one, page, measured)

if __name__ == "__main__":
    run(STUDY)
