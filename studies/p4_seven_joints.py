"""Study p4: seven joints identified from motor current or joint torque [Liu].

The paper identifies an S-R-S arm from motor currents: a Fourier series of five harmonics in 20 s is
optimised for the condition number of the regressor, positions and currents are logged at 10 ms and
smoothed twice by a moving average, and the minimal parameter set follows by least squares, as
printed (eqs. 14 to 16). It checks the model on the motion that it was identified from.

    python studies/p4_seven_joints.py -o DIR [--quick] [--seeds N]

For every seed another arm, whose parameters no estimator sees, runs five periods of the motion of
the paper's table 1 and of a motion that is designed here, and a third one that nothing was fitted
to.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from numpy.typing import NDArray

sys.path.append(str(Path(__file__).parents[1]))
from studies.support.measured import (
    HEADING,
    PANDA,
    UR10E_PROCESS,
    UR10E_RUNS,
    Errors,
    errors_on,
    example,
    log,
    percent_table,
    ur10e,
)
from studies.support.page import Claim, Page, Part, Section, Table, Text, over_seeds
from studies.support.picture import Curve, Panel, Picture
from studies.support.robots import ROBOTS, TORQUE, robot_file
from studies.support.study import Study, run

import steelyard

Array = NDArray[np.float64]

JOINTS = ("shoulder1", "shoulder2", "shoulder3", "elbow", "wrist1", "wrist2", "wrist3")
RATE, THRESHOLD = 100.0, 0.02
"""Rows of the log per second (the paper's 10 ms), and the friction's threshold [rad/s]."""

DENSE, SPAN = 200.0, 17
"""Rows per second after interpolation, and samples of the moving average: 85 ms."""

PERIODS, AROUND = 5, 0.1
"""Periods of a run, the first of which is left out; time around a reversal [s]."""

SEARCHES = 8
"""Searches of a design; the paper's one took 164 iterations."""

CONSTANTS = (0.09, 0.09, 0.09, 0.09, 0.05, 0.05, 0.05)
RATIOS = (100.0, 100.0, 100.0, 100.0, 80.0, 80.0, 80.0)
"""Torque constants [Nm/A] and gear ratios."""

CURRENT = f"""
[signals]
time = "time_s"
position = "q{{}}_rad"
[signals.effort]
columns = "current{{}}_A"
kind = "motor_current"
side = "motor"
unit = "A"
gain = {list(CONSTANTS)}
[robot.transmission]
ratios = {list(RATIOS)}
[prior]
source = "none"
"""
"""Currents of the motors; the masses of the robot file are not used."""

ROTORS = """
[model]
terms = ["rigid_body", "rotor_inertia", "viscous", "coulomb"]
"""
"""Geared drives have rotor inertia, which the paper's eq. 11 leaves out: the simulated arm has it,
and our model identifies it. Without it no controller could hold the wrist where its axes align."""

PAPER = f"""
[model]
terms = [
  "rigid_body",
  {{ law = "viscous", threshold = {THRESHOLD} }},
  {{ law = "coulomb", threshold = {THRESHOLD} }},
]
[processing]
rate = {DENSE}
motion = {{ method = "moving_average", span = {SPAN}, passes = 2 }}
effort = {{ method = "moving_average", span = {SPAN}, passes = 2 }}
matched_cutoff = "off"
rest_speed = "off"
[estimation]
method = "least_squares"
weights = "equal"
"""
"""The paper's method: eq. 3, interpolation, two moving averages, least squares by eqs. 14 to 16."""

THRESHOLDED = f"""
[model]
terms = [
  "rigid_body",
  "rotor_inertia",
  {{ law = "viscous", threshold = {THRESHOLD} }},
  {{ law = "coulomb", threshold = {THRESHOLD} }},
]
"""
"""Our model with the paper's threshold."""

PLAIN = '[model]\nterms = ["rigid_body", {}"coulomb", "viscous", "offset"]\n'
"""Our model of measured robots in the quick form: without the search for friction laws."""

PAPER_NUMBERS = "only pictures"
METHODS = ("paper, table 1", "paper, our motion", "ours")
ON_MEASURED = ("the paper's method", "ours, friction of eq. 3", "ours")
MOTIONS = ("identification", "unseen")


@dataclass(frozen=True, eq=False)
class Traces:
    """Efforts along a motion.

    Attributes:
        t: Shape `(N,)` [s].
        measured: Shape `(N, 7)` [Nm].
        predicted: By method, likewise.
    """

    t: Array
    measured: Array
    predicted: dict[str, Array]


@dataclass(frozen=True, eq=False)
class Found:
    """What one seed gave.

    Attributes:
        condition: Condition number of the designed motion.
        certified: Whether it is proven to keep all limits, and to begin and end at rest.
        searches: Searches of the design.
        printed: Condition number of the motion of table 1 on this arm.
        violations: What that motion breaks.
        errors: By method and motion: error of each joint, and of all together, as a share of the
            effort used [%], below 5 Hz where the joints move.
        reversals: By method: root mean square error of each joint on the identification motion
            within AROUND of its reversals, over that elsewhere.
        improvements: Time [s] and condition number of every improvement of the design.
        apart: Largest difference of a parameter from torques to that from currents, in standard
            deviations.
        sizes: Base inertial parameters by structure, and rank of the regressor of the rigid bodies
            along the designed motion; then all parameters of eq. 11, and those with rotors.
        motions: Our motion and that of table 1, as `sampled` returns them.
        traces: Efforts of the unseen motion.
        fitted: Efforts of the motion of table 1 and its calculation by the paper's method, fig. 4.
        filtered: The same efforts as logged, filtered once and twice, fig. 3.
    """

    condition: float
    certified: bool
    searches: int
    printed: float
    violations: tuple[str, ...]
    errors: dict[tuple[str, str], tuple[float, ...]]
    reversals: dict[str, tuple[float, ...]]
    improvements: Array
    apart: float
    sizes: tuple[int, int, int, int]
    motions: tuple[Array, ...]
    traces: Traces
    fitted: Traces
    filtered: Traces


def one(folder: Path, seed: int, quick: bool) -> Found:
    """Design, run, identify by both methods, predict an unseen motion."""
    ours = robot_file("p4_arm", folder / "ours.toml", CURRENT + ROTORS)
    sensed = robot_file("p4_arm", folder / "torque_sensors.toml", TORQUE + ROTORS)
    paper = robot_file("p4_arm", folder / "paper.toml", CURRENT + PAPER)
    thresholded = robot_file("p4_arm", folder / "threshold.toml", CURRENT + THRESHOLDED)
    bodies = robot_file("p4_arm", folder / "bodies.toml", '[model]\nterms = ["rigid_body"]')
    eq11 = robot_file("p4_arm", folder / "design.toml")
    table = printed_motion(folder / "table1.json")
    replay = robot_file(
        "p4_arm",
        folder / "table1.toml",
        f'[excitation.motion]\nkind = "replay"\nfile = "{table.name}"\n',
    )
    designed = steelyard.design_excitation(
        eq11, budget=300.0, searches=1 if quick else SEARCHES, processes=1, seed=seed
    )
    motion = designed.save(folder / "motion") / "trajectory.json"
    of_table = steelyard.design_excitation(replay, processes=1)

    def simulated(name: str, robot: Path, motion: Path | None, periods: int = 1) -> str:
        steelyard.simulate(robot, folder / name, motion, periods=periods, rate=RATE, seed=seed)
        return str(folder / name / "log.csv")

    # a second of standstill, and the first period, are left out
    window = f"@21:{1 + 20 * PERIODS}"
    log = simulated("ours", ours, motion, PERIODS) + window
    theirs = simulated("table1", ours, table, PERIODS) + window
    same_log = simulated("sensed", sensed, motion, PERIODS) + window
    unseen = simulated("unseen", ours, None)
    models = {
        "ours": identified(ours, log, unseen),
        "paper, our motion": identified(paper, log, unseen),
        "paper, table 1": identified(paper, theirs, unseen),
        "ours, threshold": identified(thresholded, log, unseen),
    }
    from_torque = identified(sensed, same_log)
    condition, printed = designed.to_dict(), of_table.to_dict()
    logs = {"paper, table 1": theirs, "paper, our motion": log, "ours": log}
    fits = {name: steelyard.residuals(models[name].model, own) for name, own in logs.items()}
    fit = fits["paper, table 1"]
    return Found(
        condition["condition"],
        condition["certified"],
        condition["searches"],
        printed["condition"],
        tuple(printed["failures"]),
        {(name, kind): errors(made, kind) for name, made in models.items() for kind in MOTIONS},
        {name: at_reversals(ours, logs[name], one) for name, one in fits.items()},
        np.array(condition["improvements"]),
        apart(models["ours"].model, from_torque.model),
        sizes((bodies, eq11, ours), designed.trajectory),
        (sampled(designed.trajectory), sampled(of_table.trajectory)),
        traces(ours, unseen, models),
        Traces(fit.t, fit.measured, {"calculated": fit.predicted, "error": fit.residual}),
        filtered(folder, theirs),
    )


def printed_motion(target: Path) -> Path:
    """Write the motion of table 1, eq. 17, as a trajectory that starts at zero."""
    table = tomlkit.parse((ROBOTS / "p4_table1.toml").read_text(encoding="utf-8")).unwrap()
    rates = 2.0 * np.pi / table["period"] * np.arange(1, 6)
    sine, cosine = (np.array(table[name]).T / rates for name in ("a", "b"))
    motion = {
        "joints": JOINTS,
        "kind": "fourier",
        "period_s": table["period"],
        "periods": 1,
        "rests": False,
        "start": [0.0] * 7,
        "sine": sine.tolist(),
        "cosine": (-cosine).tolist(),
    }
    target.write_text(json.dumps(motion, indent=1), encoding="utf-8")
    return target


def identified(robot: Path, log: str, *unseen: str) -> steelyard.Identification:
    """A model from a log, with its errors on an unseen motion, if any."""
    return steelyard.identify(robot, log, validate=unseen, check=False, threads=1)


def errors(made: steelyard.Identification, kind: str) -> tuple[float, ...]:
    """Error of each joint, then of all together, as a share of the effort used [%]."""
    numbers = made.to_dict()
    (log,) = numbers["identification" if kind == "identification" else "validation"]
    parts = (*log["headline"]["joints"], *log["headline"]["pooled"])
    return tuple(part["percent_of_used"] for part in parts)


def at_reversals(robot: Path, log: str, fit: Any) -> tuple[float, ...]:
    """Root mean square error of each joint around its reversals, over that elsewhere.

    Args:
        robot: Robot file by which velocities are computed.
        log: The log.
        fit: What `steelyard.residuals` says of it.
    """
    (run,) = steelyard.load_runs(robot, log)
    data, found = run.whole(), []
    for joint, residual in enumerate(fit.residual.T):
        turns = data.t[1:][np.diff(np.sign(data.motion.dq[:, joint])) != 0.0]
        after = np.searchsorted(turns, fit.t)
        left = np.abs(fit.t - turns[np.maximum(after - 1, 0)])
        near = np.minimum(left, np.abs(turns[np.minimum(after, len(turns) - 1)] - fit.t)) <= AROUND
        squares = np.square(residual)
        found.append(float(np.sqrt(squares[near].mean() / squares[~near].mean())))
    return tuple(found)


def filtered(folder: Path, log: str) -> Traces:
    """Efforts of a log as they are, behind one moving average and behind two [Nm]."""
    path, _, window = log.partition("@")
    names = Path(path).read_text(encoding="utf-8").partition("\n")[0].split(",")
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    start = float(window.partition(":")[0])
    rows = rows[(rows[:, 0] >= start) & (rows[:, 0] <= start + 20.0)]
    gains = np.multiply(CONSTANTS, RATIOS)
    raw = rows[:, [k for k, name in enumerate(names) if name.startswith("current")]] * gains
    smooth = {}
    for name, passes in (("filtered once", 1), ("filtered twice", 2)):
        changed = PAPER.replace("passes = 2", f"passes = {passes}")
        robot = robot_file("p4_arm", folder / f"filtered{passes}.toml", CURRENT + changed)
        (run,) = steelyard.load_runs(robot, log)
        data = run.whole()
        smooth[name] = np.column_stack(
            [np.interp(rows[:, 0], data.t, effort) for effort in data.effort.T]
        )
        smooth[name] *= gains
    return Traces(rows[:, 0], raw, smooth)


def apart(one: steelyard.IdentifiedModel, other: steelyard.IdentifiedModel) -> float:
    """Largest difference of a parameter, in standard deviations."""
    a, b = one.estimate, other.estimate
    std = np.sqrt(np.diag(a.covariance))
    return float(np.max(np.abs(a.parameters.values - b.parameters.values) / std))


def sizes(robots: Sequence[Path], motion: steelyard.Trajectory) -> tuple[int, int, int, int]:
    """Numbers of base parameters, as `Found` has them.

    Args:
        robots: Robot files with rigid bodies alone, with eq. 11, and with rotors as well.
        motion: The designed motion.
    """
    bodies, eq11, rotors = (steelyard.model_of(robot) for robot in robots)
    samples = motion.sample(np.linspace(0.0, motion.duration, 400))
    nominal = bodies.prior
    assert nominal is not None  # the robot file gives all masses
    columns = nominal.regressor(samples)
    rank = np.linalg.matrix_rank(columns.reshape(-1, columns.shape[2]))
    structure, friction, every = (len(steelyard.base_parameters(m)) for m in (bodies, eq11, rotors))
    return structure, int(rank), friction, every


def closed_form(joints: int, parallel: int) -> int:
    """Base inertial parameters of an arm with axes parallel or perpendicular [Mayeda1990].

    Args:
        joints: Revolute joints; the first one turns about the vertical.
        parallel: How many axes from the first one on are parallel to it, itself included.
    """
    return 7 * joints - 4 * parallel - 2


def sampled(motion: steelyard.Trajectory) -> Array:
    """Time, and position, velocity and acceleration of all joints, shape `(22, N)`."""
    t = np.linspace(0.0, motion.duration, 401)
    found = motion.sample(t)
    return np.vstack([t, found.q.T, found.dq.T, found.ddq.T])


def traces(robot: Path, log: str, models: dict[str, steelyard.Identification]) -> Traces:
    """Measured and predicted efforts of an unseen motion, as joint torques."""
    (unseen,) = steelyard.load_runs(robot, log)
    data = unseen.whole()
    return Traces(
        data.t,
        data.effort * np.multiply(CONSTANTS, RATIOS),
        {name: made.model.torque(data.motion) for name, made in models.items()},
    )


def page(found: Sequence[Found]) -> Page:
    """Tables, pictures and bounds."""
    first = found[0]
    conditions = [one.condition for one in found]
    unseen = [one.errors["ours", "unseen"][-1] for one in found]
    theirs = [one.errors["paper, table 1", "unseen"][-1] for one in found]
    start = np.abs(first.motions[1][15:, 0]).max()
    spans = np.ptp(first.motions[1][1:8], axis=1)
    claims = (
        Claim(
            "condition number of the designed motion, median",
            over_seeds(conditions),
            "<= 30",
            float(np.median(conditions)) <= 30.0,
        ),
        Claim(
            "limits and rest at both ends proven",
            f"{sum(one.certified for one in found)} of {len(found)} seeds",
            "all",
            all(one.certified for one in found),
        ),
        Claim(
            "error on unseen motion, all joints, every seed",
            over_seeds(unseen, "%"),
            "<= 5 %",
            max(unseen) <= 5.0,
        ),
        Claim(
            "the same against the paper's method on its own motion, every seed",
            over_seeds([a / b for a, b in zip(unseen, theirs, strict=True)]),
            "<= 1",
            all(a <= b for a, b in zip(unseen, theirs, strict=True)),
        ),
        Claim(
            "acceleration at the start of table 1's motion",
            f"{start:.2f} rad/s²",
            ">= 3.8 rad/s² (eq. 18 demands 0)",
            start >= 3.8,
        ),
    )
    parts: tuple[Part, ...] = (
        verdicts(found, start),
        story(),
        excitation_table(found, start, spans),
        course_picture(first),
        condition_picture(found),
        motion_picture(first),
        sizes_table(first),
        Text("Errors", ERRORS),
        *(error_table(found, kind) for kind in MOTIONS),
        reversal_table(found),
        filter_picture(first.filtered),
        fit_picture(first.fitted),
        error_picture(found),
        torque_picture(first.traces),
        other_table(found),
    )
    return Page("Seven joints from torque or current", parts, claims)


def verdicts(found: Sequence[Found], start: float) -> Table:
    """What the paper claims, and whether it holds here."""
    conditions = [one.condition for one in found]
    own, unseen = (np.array([f.errors["paper, table 1", kind] for f in found]) for kind in MOTIONS)
    ours = [f.errors["ours", "unseen"][-1] for f in found]
    turning = [float(np.median(f.reversals["paper, table 1"])) for f in found]
    last = [float(errors[6] / np.median(errors[:6])) for errors in own]
    rows = (
        (
            "the optimised motion has a condition number of 75.5, below 100",
            "yes" if max(conditions) < 75.5 else "partly" if min(conditions) < 100.0 else "no",
            f"designed here {over_seeds(conditions)}; table 1 on this arm {found[0].printed:.1f}",
        ),
        (
            "the motion of table 1 begins and ends without acceleration (eq. 18)",
            "no",
            f"it begins with {start:.2f} rad/s²",
        ),
        (
            "calculated and measured torques are basically consistent on the motion that is fitted",
            "yes" if own[:, 7].max() < 10.0 else "partly" if np.median(own[:, 7]) < 20.0 else "no",
            f"error of all joints {over_seeds(own[:, 7].tolist(), '%')} of the torque used",
        ),
        (
            "errors are larger near reversals",
            "yes" if min(turning) > 1.0 else "partly" if max(turning) > 1.0 else "no",
            f"error within {AROUND} s of a reversal over that elsewhere, median of the joints: "
            f"{over_seeds(turning)}",
        ),
        (
            "joint 7, which carries least, has a large relative error",
            "yes" if min(last) > 1.0 else "partly" if max(last) > 1.0 else "no",
            f"its error over the median of the others: {over_seeds(last)}",
        ),
        (
            "the parameters are accurate enough for control (checked on the fitted motion alone)",
            "yes" if unseen[:, 7].max() < 5.0 else "partly" if unseen[:, 7].max() < 20.0 else "no",
            f"error on an unseen motion {over_seeds(unseen[:, 7].tolist(), '%')}; "
            f"ours {over_seeds(ours, '%')}",
        ),
    )
    columns = ("the paper", "holds here", "figure")
    return Table("What the paper claims, and whether it holds here", rows, columns)


def reversal_table(found: Sequence[Found]) -> Table:
    """Errors near reversals."""
    rows = tuple(
        (name, "only pictures")
        + tuple(over_seeds([f.reversals[method][k] for f in found]) for method in METHODS)
        for k, name in enumerate(JOINTS)
    )
    columns = ("", "paper", "its method, table 1", "its method, our motion", "ours")
    title = f"Error within {AROUND} s of a joint's reversals over that elsewhere, fitted motion"
    return Table(title, rows, columns)


def story() -> Text:
    """What is replayed and assumed."""
    return Text(
        "",
        (
            "Liu et al. identify the seven joints of an arm of the Walker robot from motor "
            "currents. Here a simulated S-R-S arm takes its place, which runs five periods of each "
            "motion, the first of which is left out. For every seed the arm has "
            "other masses, inertias, friction and rotors; no estimator sees them, nor the masses "
            "of the robot file.",
            "Assumed, as the paper does not print it: lengths 0.30, 0.26 and 0.10 m, masses, "
            "limits of positions, speeds (2 and 3 rad/s) and accelerations (8 rad/s²), initial "
            "positions of table 1 (zero), torque constants and gear ratios, the denser grid "
            f"({DENSE:g} rows per second), span of the moving averages ({1e3 * SPAN / DENSE:.0f} "
            f"ms), threshold of friction ({THRESHOLD} rad/s), encoders of 17 bits "
            "and noise of 1 % of a joint's typical torque (studies/robots/p4_arm.toml).",
            "Different from the paper: table 1 breaks its own eq. 18, as the motion starts with an "
            "acceleration; its joints turn by several revolutions, and no limits are printed. "
            "Eq. 11 lists no rotor inertia, which geared drives have: the simulated arm has it, "
            "the paper's method leaves it out, ours identifies it. The paper checks its model on "
            "the identification motion alone.",
        ),
    )


ERRORS = (
    "Root mean square of measured minus predicted torque, below 5 Hz and where the joint moves, as "
    "a share of the torque used. The paper's method: rows interpolated to a denser grid, all "
    "smoothed twice by a moving average, velocities and accelerations by central differences, "
    "friction that is zero below a threshold (eq. 3), and least squares by eqs. 14 to 16 exactly: "
    "all samples, joints alike, the parameters of eq. 11. Ours: smoothing chosen from the data, "
    "regressor and torque behind the same filter, joints weighted by their residuals, bodies that "
    "can exist. The first column of the paper's method has its own motion of table 1, the next one "
    "our motion, so that motion and estimator can be told apart.",
)


def excitation_table(found: Sequence[Found], start: float, spans: Array) -> Table:
    """The two motions."""
    table, ours = found[0].motions[1], [one.motions[0] for one in found]
    speed, push = (np.abs(table[k : k + 7]).max() for k in (8, 15))
    fastest = over_seeds([np.abs(m[8:15]).max() for m in ours], "rad/s")
    strongest = over_seeds([np.abs(m[15:]).max() for m in ours], "rad/s²")
    widest = over_seeds([np.ptp(m[1:8], axis=1).max() for m in ours], "rad")
    return Table(
        "Excitation motion, 20 s, five harmonics",
        (
            (
                "condition number, 57 parameters",
                "75.5",
                f"{found[0].printed:.1f}",
                over_seeds([one.condition for one in found]),
            ),
            ("search", "164 iterations", "motion of table 1", f"{found[0].searches} searches"),
            ("acceleration at start and end", "0 (eq. 18)", f"{start:.2f} rad/s²", "0, proven"),
            (
                "widest range of a joint",
                "not printed",
                f"{spans.max():.1f} rad ({spans.max() / (2.0 * np.pi):.1f} turns)",
                widest,
            ),
            ("highest speed", "not printed", f"{speed:.2f} rad/s", fastest),
            ("highest acceleration", "not printed", f"{push:.2f} rad/s²", strongest),
            (
                "limits of this arm that are exceeded",
                "not printed",
                f"{len(found[0].violations)}",
                "none, proven",
            ),
        ),
    )


def sizes_table(first: Found) -> Table:
    """The minimal set."""
    structure, rank, eq11, rotors = first.sizes
    missing = "not printed"
    return Table(
        "Minimal set",
        (
            ("inertial, by structure", missing, "", f"{structure}"),
            ("inertial, rank of the regressor along the motion", missing, "", f"{rank}"),
            ("inertial, closed form 7·7 − 4·1 − 2", missing, "", f"{closed_form(7, 1)}"),
            ("with Coulomb and viscous friction (eq. 11)", missing, f"{eq11}", f"{eq11}"),
            ("with rotor inertias", "left out", "left out", f"{rotors}"),
        ),
    )


def error_table(found: Sequence[Found], kind: str) -> Table:
    """Errors of each joint by method."""
    where = "the identification motion (fig. 4)" if kind == MOTIONS[0] else "an unseen motion"
    shown = PAPER_NUMBERS if kind == MOTIONS[0] else "not examined"
    rows = tuple(
        (name, shown)
        + tuple(over_seeds([f.errors[m, kind][k] for f in found], "%") for m in METHODS)
        for k, name in enumerate((*JOINTS, "all joints"))
    )
    columns = ("", "paper", "its method, table 1", "its method, our motion", "ours")
    return Table(f"Error on {where}", rows, columns)


def other_table(found: Sequence[Found]) -> Table:
    """Torque against current, sign against threshold."""
    plain, thresholded = (
        over_seeds([f.errors[name, "unseen"][-1] for f in found], "%")
        for name in ("ours", "ours, threshold")
    )
    apart = over_seeds([one.apart for one in found], "std", digits=2)
    return Table(
        "Variants of one run",
        (
            ("torque sensors against currents: largest change of a parameter", "–", "–", apart),
            ("unseen error, friction by the sign of the speed", "–", "–", plain),
            (f"unseen error, no friction up to {THRESHOLD} rad/s (eq. 3)", "–", "–", thresholded),
        ),
    )


def course_picture(first: Found) -> Picture:
    """Fig. 2, over the time of the search instead of its iterations."""
    t, best = np.repeat(first.improvements, 2, axis=0).T
    curves = (
        Curve("best so far", t[1:], best[:-1], colour=0),
        Curve("paper, after 164 iterations", [t[0], t[-1]], [75.5] * 2, colour=1),
    )
    panel = Panel("Condition number", "time of the search [s]", "", curves, log=True)
    caption = "Condition number of the best motion during the design, first seed (fig. 2)."
    return Picture("course", caption, (panel,), columns=1)


def condition_picture(found: Sequence[Found]) -> Picture:
    """Condition numbers of all seeds, the end of fig. 2."""
    seeds, ends = np.arange(len(found)), [-0.5, len(found) - 0.5]
    curves = (
        Curve("designed", seeds, [one.condition for one in found], points=True, colour=0),
        Curve("paper 75.5", ends, [75.5] * 2, colour=1),
        Curve("table 1 here", ends, [found[0].printed] * 2, colour=4),
    )
    caption = (
        "Condition numbers of the designed motions, that of the paper's arm (end of its fig. 2), "
        "and that of table 1's motion on this arm."
    )
    ticks = tuple(str(seed) for seed in seeds)
    panel = Panel("Condition number", "seed", "", curves, log=True, ticks=ticks)
    return Picture("condition", caption, (panel,), columns=1)


def motion_picture(first: Found) -> Picture:
    """Positions and accelerations of both motions."""
    panels = [
        Panel(f"{name}: {what}", "time [s]", unit, tuple(Curve("", m[0], c) for c in m[k : k + 7]))
        for what, unit, k in (("positions", "rad", 1), ("accelerations", "rad/s²", 15))
        for name, m in zip(("our motion", "table 1"), first.motions, strict=True)
    ]
    caption = (
        "Our motion and that of table 1, seven joints. Ours starts and ends at rest without "
        "acceleration, and stays within the limits."
    )
    return Picture("motions", caption, tuple(panels))


def error_picture(found: Sequence[Found]) -> Picture:
    """Errors on the unseen motion, a dot per seed."""
    x = np.repeat(np.arange(8), len(found)).astype(float)
    curves = tuple(
        Curve(
            name,
            x + 0.2 * (k - 1),
            np.array([f.errors[name, "unseen"] for f in found]).T.ravel(),
            points=True,
            colour=(1, 4, 0)[k],
        )
        for k, name in enumerate(METHODS)
    )
    ticks = ("sh. 1", "sh. 2", "sh. 3", "elbow", "wr. 1", "wr. 2", "wr. 3", "all")
    panel = Panel("unseen motion", "", "error [% of torque used]", curves, log=True, ticks=ticks)
    caption = "Errors on the unseen motion, one dot per seed; the scale is logarithmic."
    return Picture("errors", caption, (panel,), columns=1)


def drawn(
    traces: Traces, seconds: tuple[float, float], name: str, colours: Sequence[int]
) -> tuple[Panel, ...]:
    """A panel per joint with the measured effort and all others, within some seconds."""
    shown = (traces.t >= traces.t[0] + seconds[0]) & (traces.t <= traces.t[0] + seconds[1])
    every = ((name, traces.measured), *traces.predicted.items())
    return tuple(
        Panel(
            joint,
            "time [s]",
            "Nm",
            tuple(
                Curve(label, traces.t[shown], values[shown, k], colour=colour)
                for (label, values), colour in zip(every, colours, strict=True)
            ),
        )
        for k, joint in enumerate(JOINTS)
    )


def filter_picture(traces: Traces) -> Picture:
    """Fig. 3."""
    caption = (
        "Torques of table 1's motion from the currents, two seconds of the first seed: as logged, "
        "behind one moving average, and behind two (fig. 3)."
    )
    return Picture("filtered", caption, drawn(traces, (2.0, 4.0), "logged", (2, 0, 1)))


def fit_picture(traces: Traces) -> Picture:
    """Fig. 4."""
    caption = (
        "Measured and calculated torques of one period of table 1's motion, to which the paper's "
        "method is fitted, and their difference, first seed (fig. 4)."
    )
    return Picture("fit", caption, drawn(traces, (0.0, 20.0), "measured", (2, 0, 1)))


def torque_picture(traces: Traces) -> Picture:
    """Measured and predicted torques, fig. 4."""
    panels = tuple(
        Panel(
            name,
            "time [s]",
            "Nm",
            (
                Curve("measured", traces.t, traces.measured[:, k], colour=4),
                Curve("paper", traces.t, traces.predicted["paper, table 1"][:, k], colour=1),
                Curve("ours", traces.t, traces.predicted["ours"][:, k], colour=0),
            ),
        )
        for k, name in enumerate(JOINTS)
    )
    caption = (
        "Measured torque of the unseen motion of the first seed, and predictions of the paper's "
        "method and of ours."
    )
    return Picture("torques", caption, panels)


@dataclass(frozen=True)
class Robot:
    """A measured robot.

    Attributes:
        name: Short name.
        words: Its efforts and motions.
        file: Robot file in `examples/` with the laws of our model.
        rotors: Whether the efforts move rotors.
        fitted: Logs of the identification, the last of which is compared.
        unseen: A log of another motion.
    """

    name: str
    words: str
    file: str
    rotors: bool
    fitted: tuple[str, ...]
    unseen: str


@dataclass(frozen=True)
class OfRobot:
    """What the methods of `ON_MEASURED` gave on a measured robot.

    Attributes:
        robot: Which one.
        errors: By motion and method.
        reversals: Of the paper's method: see `at_reversals`, median of the joints.
    """

    robot: Robot
    errors: dict[str, dict[str, Errors]]
    reversals: float

    def all_joints(self, motion: str, method: str) -> float:
        """Error of all joints together [%]."""
        return self.errors[motion][method].percent[-1]


def measured(folder: Path, quick: bool) -> Section:
    """The paper's method and ours on a Panda and on a UR10e."""
    runs = ur10e(*(UR10E_RUNS[:2] if quick else UR10E_RUNS))
    robots = (
        Robot(
            "Panda",
            "torque sensors, 8.9 s of one Fourier motion; unseen: the next 4.3 s of it, before it "
            "repeats",
            "panda",
            False,
            (log(PANDA, "@0.6:9.5"),),
            log(PANDA, "@9.5:13.8"),
        ),
        Robot(
            "UR10e",
            f"motor currents times published gains, {len(runs)} Fourier motions; unseen: from "
            "point to point through ten postures",
            "ur10e_auto",
            True,
            tuple(runs),
            log(UR10E_PROCESS),
        ),
    )
    found = tuple(on_robot(robot, folder / robot.file, quick) for robot in robots)
    tables = (
        percent_table(f"{one.robot.name}: error on {words}", one.errors[motion])
        for one in found
        for motion, words in zip(MOTIONS, ("the fitted motion", "unseen motion"), strict=True)
    )
    story = Text(HEADING, (*(f"{one.name}: {one.words}." for one in robots), ON_ROBOTS))
    return Section((story, measured_verdicts(found), *tables), () if quick else bounds(found))


def on_robot(robot: Robot, folder: Path, quick: bool) -> OfRobot:
    """Identify a measured robot by all methods, and compare them on both motions."""
    rotors = '"rotor_inertia", ' * robot.rotors
    eq3 = THRESHOLDED if robot.rotors else THRESHOLDED.replace('  "rotor_inertia",\n', "")
    ours = PLAIN.format(rotors) if quick else ""
    files = [
        example(robot.file, folder / f"{name}.toml", tables, laws_from_data=tables == "")
        for name, tables in (("paper", PAPER), ("eq3", eq3), ("ours", ours))
    ]
    models = {
        method: steelyard.identify(file, robot.fitted, check=False, threads=1).model
        for method, file in zip(ON_MEASURED, files, strict=True)
    }
    logs = dict(zip(MOTIONS, (robot.fitted[-1], robot.unseen), strict=True))
    turning = at_reversals(
        files[-1], logs[MOTIONS[0]], steelyard.residuals(models[ON_MEASURED[0]], logs[MOTIONS[0]])
    )
    return OfRobot(
        robot,
        {motion: errors_on(models, one, like="ours") for motion, one in logs.items()},
        float(np.nanmedian(turning)),
    )


ON_ROBOTS = (
    "The paper's method as above, equal weights, all samples, the threshold and the moving "
    f"averages of the simulated arm (the grid of {DENSE:g} rows per second is coarser than the "
    "Panda's 1000). Between it and ours stands our estimation with the paper's friction. Ours: the "
    "robot file of examples/, whose friction laws are chosen from the fitted logs (in the quick "
    "form Coulomb, viscous and an offset, without a choice). All methods are compared on the same "
    "signals, those of ours, below the cut-off of the robot file."
)


def measured_verdicts(found: Sequence[OfRobot]) -> Table:
    """The paper's claims on measured robots."""
    paper, eq3, ours = ON_MEASURED

    def each(values: Sequence[float], unit: str = "") -> str:
        return "; ".join(
            f"{one.robot.name} {value:.3g}{unit}" for one, value in zip(found, values, strict=True)
        )

    def holds(true: Sequence[bool]) -> str:
        return "yes" if all(true) else "partly" if any(true) else "no"

    fit, unseen = ([one.all_joints(motion, paper) for one in found] for motion in MOTIONS)
    last = [
        float(errors[-2] / np.median(errors[:-2]))
        for errors in (one.errors[MOTIONS[0]][paper].percent for one in found)
    ]
    turning = [one.reversals for one in found]
    others = (
        f"{words} {each([one.all_joints(MOTIONS[1], method) for one in found], ' %')}"
        for words, method in (("our estimation with its friction", eq3), ("ours", ours))
    )
    rows = (
        (
            "calculated and measured torques are basically consistent on the motion that is fitted",
            holds([error < 10.0 for error in fit]),
            f"error of all joints {each(fit, ' %')}",
        ),
        (
            "errors are larger near reversals",
            holds([ratio > 1.0 for ratio in turning]),
            f"error within {AROUND} s of a reversal over that elsewhere {each(turning)}",
        ),
        (
            "the last joint, which carries least, has a large relative error",
            holds([ratio > 1.0 for ratio in last]),
            f"its error over the median of the others {each(last)}",
        ),
        (
            "the parameters are accurate enough for control (checked on the fitted motion alone)",
            holds([error < 5.0 for error in unseen]),
            f"error on unseen motion {each(unseen, ' %')}; over that on the fitted one "
            f"{each(np.divide(unseen, fit).tolist())}; {'; '.join(others)}",
        ),
    )
    columns = ("the paper", "holds there", "figure")
    return Table("What the paper claims, and whether it holds on measured robots", rows, columns)


def bounds(found: Sequence[OfRobot]) -> tuple[Claim, ...]:
    """Ours against the paper's method on unseen motion."""
    paper, _, ours = ON_MEASURED
    ratios = [one.all_joints(MOTIONS[1], ours) / one.all_joints(MOTIONS[1], paper) for one in found]
    return tuple(
        Claim(
            f"measured {one.robot.name}: error on unseen motion, all joints, "
            "over that of the paper's method",
            f"{ratio:.3g}",
            "< 1",
            ratio < 1.0,
        )
        for one, ratio in zip(found, ratios, strict=True)
    )


STUDY = Study("p4", one, page, measured)

if __name__ == "__main__":
    run(STUDY)
