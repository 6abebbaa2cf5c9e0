"""Study p1: a leg's model is made smaller by the torque contribution of its parameters [Wang].

The paper identifies a leg of two joints with 12 parameters. It designs a motion for the condition
number of the regressor, runs it, identifies, removes the parameter that contributes least to the
torques, designs the next motion for those that are left, and so on; four parameters go. On a circle
of the foot the reduced model predicts better than the full one, and than the full one from a better
motion.

    python studies/p1_reduction.py -o DIR [--quick] [--seeds N]

For every seed another leg, whose parameters no estimator sees, goes through the whole loop. Models
are then identified five times each, from as much data each, and predict the circle.
"""

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.append(str(Path(__file__).parents[1]))
from studies.support.page import Claim, Page, Part, Table, Text, over_seeds
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

REMOVED, REPEATS = 4, 5
"""Parameters that the paper removes, and its repeated estimations; 1 and 2 in the quick form."""

CALIBRATED = """
[estimation]
effort_scales = "off"
"""
"""The torque sensors are calibrated; scales of the torques would be estimated with the masses."""

PAPER = f"""
[processing]
rate = {1.0 / STEP}
motion = {{ method = "moving_average", span = 5 }}
effort = {{ method = "moving_average", span = 9 }}
"""
"""Central differences, accelerations averaged over 5 points and torques over 9."""

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

FITTED = MODELS[:4]
"""Those whose errors on their own excitation motion are compared."""

Errors = dict[str, Array]
"""By model: per repeated estimation the root mean square errors of hip and knee [Nm], and both
together relative to the torques [%], shape `(repeats, 3)`."""


@dataclass(frozen=True, eq=False)
class Found:
    """What one seed gave.

    Attributes:
        conditions: Condition number by round.
        removed: Parameters in the order of their removal.
        better: Condition number of the better motion for the full model.
        names: Parameters of the reduced model.
        units: Their units.
        estimates: Their repeated estimates, shape `(repeats, p)`.
        consistent: Those of ours, of the full model, likewise.
        truth: Their true values, which nothing but this comparison sees.
        fitted: Errors on the excitation motion, against measured torques.
        measured: Errors on the circle against measured torques.
        true: Errors on the circle against torques without noise, where both joints move.
        motions: Positions of the first and the last motion and of the circle, `(N, 2)` each.
        torques: Measured on the circle, and predicted by full and reduced model and ours.
    """

    conditions: tuple[float, ...]
    removed: tuple[str, ...]
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
    torques: tuple[Array, ...]


def one(folder: Path, seed: int, quick: bool) -> Found:
    """The loop, repeated estimations of each model, and the circle."""
    removed, repeats, searches = (1, 2, 1) if quick else (REMOVED, REPEATS, 16)
    leg = robot_file("p1_leg", folder / "leg.toml", TORQUE + PAPER)
    ours = robot_file("p1_leg", folder / "ours.toml", TORQUE + CALIBRATED)
    designed = steelyard.design_excitation(
        leg, budget=300.0, searches=searches, processes=1, seed=seed + 100
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
        searches=1 if quick else 2,
        processes=1,
        seed=seed,
        check=False,
    )
    first, last = rounds[0], rounds[-1]
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
    estimates, models = [], []
    motion, clean, noisy, moving = validation(leg, folder, test, random)
    for repeat in range(repeats):
        for name, run_of in recorded.items():
            log = folder / f"{name.replace(', ', '_').replace(' ', '_')}_{repeat}.csv"
            run_of.write(log, random)
            left = kept if name == "reduced" else names
            values = least_squares(leg, log, left)
            predictions[name].append(predicted(leg, left, values, motion))
            fits[name].append(residual(leg, log, partial(predicted, leg, left, values)))
            if name == "reduced":
                estimates.append(values)
            if name == "full, better motion":
                model = steelyard.identify(ours, log, check=False, threads=1).model
                smaller = steelyard.reduce(model, log, threads=1).model
                models.append(model.estimate.parameters)
                fits["ours"].append(residual(leg, log, model.torque))
                predictions["ours"].append(model.torque(motion))
                predictions["ours, reduced"].append(smaller.torque(motion))
    return Found(
        tuple(r.condition for r in rounds),
        last.removed,
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
        (recorded["full"].q, recorded["reduced"].q, test.q),
        (noisy, *(predictions[name][0] for name in ("full", "reduced", "ours"))),
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


def residual(robot: Path, log: Path, torque: Callable[[steelyard.Motion], Array]) -> Array:
    """Errors of a model on the log that it was fitted to, as those of `Errors`."""
    (run_of,) = steelyard.load_runs(robot, log)
    data = run_of.whole()
    return relative(torque(data.motion), data.effort)


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
    return data.motion, clean, data.effort, np.asarray(data.moving.all(axis=1), dtype=bool)


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
    falls = sum(all(np.diff(one.conditions) <= 0.0) for one in found)
    loop = difference(found, "reduced", "full", "true")
    bounds = (
        ("default reduction minus full model", "ours, reduced", "full"),
        ("default reduction minus full model from the same logs", "ours, reduced", MODELS[1]),
        ("consistent estimate minus full model from the same logs", "ours", MODELS[1]),
    )
    gaps = [(name, *difference(found, one, other, "true")) for name, one, other in bounds]
    claims = (
        Claim(
            "the condition number never rises from round to round",
            f"{falls} of {len(found)} seeds",
            "all",
            falls == len(found),
        ),
        *(
            Claim(
                f"{name}, true torques of the circle",
                f"{gap:+.3f} ± {error:.3f} %",
                "<= one standard error",
                gap <= error,
            )
            for name, gap, error in gaps
        ),
    )
    parts: tuple[Part, ...] = (
        story(loop, len(found[0].removed)),
        rounds_table(found),
        condition_picture(found),
        printed_table(),
        estimates_table(found[0]),
        fitted_table(found),
        *(circle_table(found, kind) for kind in ("measured", "true")),
        motion_picture(found[0]),
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


def story(loop: tuple[float, float], removed: int) -> Text:
    """What is replayed, assumed and different.

    Args:
        loop: `difference` of the loop's reduced model to the full one.
        removed: Parameters that the loop removed.
    """
    gap, error = loop
    verdict = "is open" if abs(gap) <= error else f"is {'not ' if gap > 0.0 else ''}confirmed"
    return Text(
        "",
        (
            "Wang et al. reduce the model of a rehabilitation robot's leg: after each motion the "
            "parameter with the smallest relative contribution to the torques goes, and a motion "
            "for the others is designed. Here a simulated leg takes its place, for every seed one "
            "with other masses and friction; no estimator sees them, nor the masses of the robot "
            "file.",
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
            "The loop is to end at a condition number of 100 and is ended at 503.4.",
            f"The reduced model of the paper's loop has an error on the true torques of the circle "
            f"that is {abs(loop[0]):.3f} ± {loop[1]:.3f} % (mean over the seeds and its standard "
            f"error) of the torques "
            f"{'larger' if loop[0] > 0.0 else 'smaller'} than that of the full model. That a model "
            f"without the {removed} parameters of least contribution predicts better {verdict} on "
            "this leg: a small contribution does not mean that a parameter is insignificant. Ours "
            "is the consistent estimate of the full model (valid bodies, friction >= 0, joints "
            "weighted, smoothing chosen from the data) from the logs of the better motion, which "
            "16 searches designed for the full model (in the loop 2); the default reduction of it "
            "removes what is not significant on left-out data.",
            "Against measured torques ours is no better than least squares: most of that error is "
            "noise, and at reversals of the slow joints, where friction changes its sign, least "
            "squares on averaged torques has made friction smaller than it is. The last table "
            "leaves out the reversals and the noise.",
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
    order = ", ".join(found[0].removed)
    return Table(
        "The loop (fig. 3)",
        (
            *rows,
            ("full model, better motion", "not printed", better, better),
            ("removed, in this order (first seed)", "p1, p3, p10, p12", order, "–"),
        ),
    )


def printed_table() -> Table:
    """Spread of the paper's table I, by both formulas."""
    rows = []
    for name, (*values, printed) in TABLE_1.items():
        population = 100.0 * np.std(values) / abs(np.mean(values))
        cells = f"{np.mean(values):.4f}", f"{printed:.4f}", f"{population:.4f}"
        rows.append((name, *cells, f"{population / np.sqrt(5.0):.4f}"))
    columns = ("", "mean", "printed [%]", "population std [%]", "eq. 14 as printed [%]")
    return Table("The paper's table I, corrected", tuple(rows), columns)


def estimates_table(first: Found) -> Table:
    """Table I here."""
    sets = [(x.mean(axis=0), x.std(axis=0)) for x in (first.estimates, first.consistent)]
    cells = [
        [f"{m:.4f} ({100.0 * s / abs(m):.2g} %)" for m, s in zip(mean, spread, strict=True)]
        for mean, spread in sets
    ]
    rows = tuple(
        (f"{name} [{unit}]", theirs, ours, f"{true:.4f}")
        for name, unit, theirs, ours, true in zip(
            first.names, first.units, *cells, first.truth, strict=True
        )
    )
    title = (
        f"Table I here, first seed: mean and population std of {len(first.estimates)} estimations "
        "(the paper's: 0.01 to 12 %)"
    )
    return Table(title, rows, ("", "the paper's method: reduced", "ours: full", "true value"))


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
    """Figs. 2, 4 and 7a."""
    titles = ("full model (fig. 2)", "reduced model (fig. 4)", "circle (fig. 7a)")
    panels = tuple(
        Panel(
            title,
            "time [s]",
            "rad",
            tuple(
                Curve(joint, 0.01 * np.arange(len(q)), q[:, k])
                for k, joint in enumerate(("hip", "knee"))
            ),
        )
        for title, q in zip(titles, first.motions, strict=True)
    )
    return Picture("motions", "One period of the motions of the first seed.", panels)


def torque_picture(first: Found) -> Picture:
    """Fig. 7b to d."""
    names = ("measured", "full", "reduced", "ours")
    panels = tuple(
        Panel(
            joint,
            "time [s]",
            "Nm",
            tuple(
                Curve(name, STEP * np.arange(len(tau)), tau[:, k], colour=colour)
                for name, tau, colour in zip(names, first.torques, (4, 1, 2, 0), strict=True)
            ),
        )
        for k, joint in enumerate(("hip", "knee"))
    )
    caption = "Torques on the circle of the first seed, measured and predicted (fig. 7)."
    return Picture("torques", caption, panels)


STUDY = Study("p1", one, page)

if __name__ == "__main__":
    run(STUDY)
