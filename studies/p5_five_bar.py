"""Study p5: a five-bar arm, least squares beside a genetic algorithm, computed torque [WangC].

The paper identifies a rehabilitation arm, a parallelogram with two motors on one axis, from
minimum-jerk reaches to eight targets at 50 Hz: least squares with 7 parameters, a genetic algorithm
with 9 and 11, as friction differs by direction. The tip then follows a circle under PD computed
torque.

    python studies/p5_five_bar.py -o DIR [--quick] [--seeds N]

For every seed another arm, whose parameters no estimator sees, reaches to targets 1 to 4
(identification) and 5 to 8 (validation), and follows the circle under each law.
"""

import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

sys.path.append(str(Path(__file__).parents[1]))
from studies.support.page import Claim, Page, Part, Table, Text, over_seeds
from studies.support.picture import Curve, Panel, Picture
from studies.support.robots import ROBOTS, robot_file
from studies.support.study import Study, run

import steelyard

Array = NDArray[np.float64]

L1, L2, CENTRE, RADIUS = 0.3, 0.4, 0.4, 0.2
"""Bars, and the circle of targets, which is that of eq. 26 [m]."""

RATE, MOVE, PERIODS = 50.0, 1.2, 6
"""Rows per second, time of a reach [s]; periods, of which the first and the last are left out."""

KP, KV = 100.0, 5.0
NOISE = (0.03, 0.09)
"""White noise of the logged torques [Nm], of the size of the paper's best residuals."""

FRICTION = {
    "directional_viscous_forward": (0.2202, 0.4776),
    "directional_viscous_backward": (0.2644, 0.5482),
    "directional_coulomb_forward": (0.0082, 0.2446),
    "directional_coulomb_backward": (0.2580, 0.0036),
}
"""Table III; every seed changes each value by up to SPREAD."""

SPREAD, TURNED = 0.2, 0.01
"""Relative; and the speed over which the true Coulomb friction changes its direction [rad/s]."""

TERMS = {
    7: ("viscous", "coulomb"),
    9: ("viscous", "directional_coulomb"),
    11: ("directional_viscous", "directional_coulomb"),
}
"""Friction laws by number of parameters."""

PRINTED = {
    7: (0.0593, 0.1609, 0.2380, 0.2028, 0.1209, 0.2637, 0.1704),
    9: (0.0776, 0.1843, 0.2297, 0.1880, 0.0222, 0.2807, 0.5518, 0.2073, 0.0054),
    11: (0.0744, 0.1843, 0.2390, 0.2202, 0.2644, 0.0082, 0.2580, 0.4776, 0.5482, 0.2446, 0.0036),
}
"""Tables II, IV and III, in the order of `names`."""

PRINTED_ERRORS = {7: ("0.1163", "0.2006"), 9: ("0.0358", "0.1017"), 11: ("not legible",) * 2}
"""Table V [Nm]."""

TABLES = {7: "II", 9: "IV", 11: "III"}

INDIVIDUALS, GENERATIONS, CROSSOVER, MUTATION, STEP = 30, 100, 0.8, 0.2, 0.1
"""Of the genetic algorithm. The paper prints the first two; its genes are searched from 0 to 1."""

RULED = """
[[knowledge]]
kind = "parameter"
parameter = "my.*"
value = 0.0
"""
"""Centres of mass lie on the bars, as in eq. 1."""

FILTERED = """
[processing]
motion = "kalman_filter"
effort = { method = "butterworth", cutoff = 10.0 }
[estimation]
method = "OLS"
"""
"""The paper's signals: zero-phase torque filter, Kalman filter; ordinary least squares."""

SMOOTHED = """
[processing]
motion = "kalman"
effort = { method = "butterworth", cutoff = 10.0 }
"""
"""The same with the smoother: its accelerations are not late."""

LAWS = ("PD alone", "computed torque, eq. 29", "computed torque with friction")


@dataclass(frozen=True, eq=False)
class Samples:
    """One log as columns of eq. 13.

    Attributes:
        t: Shape `(N,)` [s].
        columns: By number of parameters p: shape `(N, 2, p)`.
        effort: Shape `(N, 2)` [Nm].
    """

    t: Array
    columns: dict[int, Array]
    effort: Array

    def rows(self, size: int) -> tuple[Array, Array]:
        """Eqs. 18 and 19: shapes `(2 N, p)` and `(2 N,)`."""
        return self.columns[size].reshape(-1, size), self.effort.ravel()

    def errors(self, values: Array) -> Array:
        """Eq. 25: root mean square error of each joint [Nm], shape `(2,)`."""
        residuals = self.effort - self.columns[len(values)] @ values
        return np.asarray(np.sqrt(np.mean(residuals**2, axis=0)))


@dataclass(frozen=True, eq=False)
class Found:
    """What one seed gave.

    Attributes:
        quick: Whether times are too short to claim anything from.
        values: Parameters by method and number of them, in the order of `names`.
        truth: The true ones, 11.
        errors: Validation error of each joint, likewise [Nm].
        training: Error of all samples of the identification (eq. 24), likewise [Nm].
        ratio: Time of the genetic algorithm over that of constrained least squares by number of
            parameters, see `times`.
        certified: Whether the three motions keep all limits.
        tip: RMS deviation of the tip from the circle by model and law [mm]; a quick study has those
            of our model alone.
        circle: Time [s] and deviations [mm] of our model's laws, in the order of `LAWS`.
        traces: Time and torques of validation: measured, by the paper's 7 parameters, by our 11.
        path: Tip on the way to all targets, shape `(N, 2)` [m].
    """

    quick: bool
    values: dict[tuple[str, int], Array]
    truth: Array
    errors: dict[tuple[str, int], Array]
    training: dict[tuple[str, int], float]
    ratio: dict[int, tuple[float, float]]
    certified: bool
    tip: dict[tuple[str, str], float]
    circle: tuple[Array, ...]
    traces: tuple[tuple[Array, Array], ...]
    path: Array


def one(folder: Path, seed: int, quick: bool) -> Found:
    """Reach, identify by all methods, follow the circle."""
    rng = np.random.default_rng(seed)
    arm = steelyard.load_robot(robot_file("p5_arm", folder / "arm.toml", tables()))
    steelyard.simulate(arm, folder / "drawn", period=0.5, seed=seed)
    truth = drawn_truth(arm, folder / "drawn" / "truth.json", folder / "truth.json", rng)
    motions = {
        "identification": planned(folder, "identification", reaches(range(1, 5))),
        "validation": planned(folder, "validation", reaches(range(5, 9))),
        "circle": planned(folder, "circle", circle()),
    }
    periods = 1 if quick else PERIODS
    logs = {
        name: logged(arm, folder / name, truth, periods, rng, seed)
        for name in ("identification", "validation")
    }
    filtered, smoothed = (
        {name: samples(folder, prepared, log) for name, log in logs.items()}
        for prepared in (FILTERED, SMOOTHED)
    )
    solvers: dict[str, Callable[[Array, Array, int], Array]] = {
        "least squares": least_squares,
        "genetic": genetic,
        "constrained": constrained,
    }
    values = {
        (method, size): solve(*filtered["identification"].rows(size), seed)
        for method, solve in solvers.items()
        for size in TERMS
    }
    ours = {size: identified(folder, f"ours{size}", size, SMOOTHED, logs) for size in TERMS}
    values |= {("ours", size): own_values(made.model, size) for size, made in ours.items()}
    data = {method: filtered for method, _ in values} | {"ours": smoothed}
    models = [ours[11].save(folder / "ours_11")]
    if not quick:
        models.append(identified(folder, "paper", 9, FILTERED, logs).save(folder / "paper_9"))
    tracked = steelyard.track(
        arm,
        motions["circle"][0],
        models,
        truth=truth,
        tool="tip",
        control=f"computed_torque,kp={KP:g},kv={KV:g}",
    ).tracking
    pd, *laws = tracked.runs
    runs = {"ours": (pd, *laws[:2])} | ({} if quick else {"paper": (pd, *laws[2:])})
    seen, unseen = filtered["validation"], smoothed["validation"]
    return Found(
        quick,
        values,
        true_values(truth),
        {key: data[key[0]]["validation"].errors(v) for key, v in values.items()},
        {
            key: float(np.sqrt(np.mean(data[key[0]]["identification"].errors(v) ** 2)))
            for key, v in values.items()
        },
        {} if quick else {size: times(*filtered["identification"].rows(size)) for size in TERMS},
        all(certified for _, certified, _ in motions.values()),
        {
            (name, law): 1e3 * run.tool_rms
            for name, own in runs.items()
            for law, run in zip(LAWS, own, strict=True)
        },
        (tracked.t, *(1e3 * run.deviation for run in runs["ours"])),
        (
            (unseen.t, unseen.effort),
            (seen.t, seen.columns[7] @ values["least squares", 7]),
            (unseen.t, unseen.columns[11] @ values["ours", 11]),
        ),
        np.concatenate([motions[name][2] for name in ("identification", "validation")]),
    )


def tables(more: str = "") -> str:
    """The robot file's place of the model, and other tables."""
    return f'[robot]\nurdf = "{ROBOTS / "p5_arm.urdf"}"\n{more}'


def drawn_truth(
    arm: steelyard.LoadedRobot, drawn: Path, target: Path, rng: np.random.Generator
) -> Path:
    """Write a true arm: bars of other densities, friction of table III, every value by seed."""
    truth = json.loads(drawn.read_text(encoding="utf-8"))
    nominal = steelyard.model_of(arm).prior
    assert nominal is not None  # the URDF has all masses
    change = {f"link{k}": rng.uniform(1.0 - SPREAD, 1.0 + SPREAD) for k in range(1, 5)}
    known = nominal.values.as_dict()
    values = {n: v * change[n.split(".")[1]] for n, v in known.items() if ".link" in n}
    for law, sizes in FRICTION.items():
        for joint, size in enumerate(sizes, start=1):
            values[f"{law}.q{joint}"] = size * rng.uniform(1.0 - SPREAD, 1.0 + SPREAD)
    for name, value in values.items():
        truth["parameters"][name]["value"] = value
    truth["smoothing"] = {name: max(v, TURNED) for name, v in truth["smoothing"].items()}
    target.write_text(json.dumps(truth, indent=1), encoding="utf-8")
    return target


def true_values(truth: Path) -> Array:
    """Eq. 14 of the true bodies, and the friction, in the order of `names(11)`."""
    parameters = json.loads(truth.read_text(encoding="utf-8"))["parameters"]
    p = {name: one["value"] for name, one in parameters.items()}
    inertial = (
        p["Izz.link1"] + p["Izz.link3"] + p["m.link4"] * L1**2,
        p["mx.link3"] * L2 + p["mx.link4"] * L1,
        p["Izz.link2"] + p["Izz.link4"] + p["m.link3"] * L2**2,
    )
    return np.array([*inertial, *(p[name] for name in names(11)[3:])])


def names(size: int) -> tuple[str, ...]:
    """Standard parameters whose columns are those of eq. 13, in the order of the paper's tables.

    With all others zero, inertias of links 1 and 4 are phi 1 and 3; the first moment of link 4
    times the length of link 1 is phi 2.
    """
    laws = [
        [f"{law}{side}" for side in (("_forward", "_backward") if "direct" in law else ("",))]
        for law in TERMS[size]
    ]
    friction = [f"{law}.q{joint}" for joint in (1, 2) for both in laws for law in both]
    return ("Izz.link1", "mx.link4", "Izz.link4", *friction)


def labels(size: int) -> tuple[str, ...]:
    """What the parameters are, with units."""
    inertial = ("φ1 [kg m²]", "φ2 [kg m²]", "φ3 [kg m²]")
    return inertial + tuple(
        f"{name.replace('directional_', '').replace('_', ' ').replace('.q', ', joint ')} "
        f"[{'Nm s' if 'viscous' in name else 'Nm'}]"
        for name in names(size)[3:]
    )


def reaches(targets: range) -> str:
    """Reaches from the centre to targets and back; target 1 is at 45 degrees."""
    angles = 0.25 * np.pi * np.array(targets)
    x, y = RADIUS * np.cos(angles), CENTRE + RADIUS * np.sin(angles)
    places = [[a, b, 0.0] for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    return f"""
[excitation.motion]
kind = "cartesian_reaching"
home = [0.0, {CENTRE}, 0.0]
targets = {places}
move = {MOVE}
dwell = 0.0
"""


def circle() -> str:
    """Eq. 26: 7.2 s a turn, with ramps of the speed at both ends."""
    return f"""
[excitation.motion]
kind = "circle"
centre = [0.0, {CENTRE}, 0.0]
radius = {RADIUS}
period = 7.2
laps = 1
ramp = 1.0
"""


def planned(folder: Path, name: str, motion: str) -> tuple[Path, bool, Array]:
    """A motion's file, whether it is proven to keep all limits, and the path of the tip."""
    robot = robot_file("p5_arm", folder / f"{name}.toml", tables(motion))
    made = steelyard.design_excitation(robot, processes=1)
    q = made.trajectory.sample(np.linspace(0.0, made.trajectory.duration, 400)).q
    tip = L2 * np.array([np.cos(q[:, 1]), np.sin(q[:, 1])]).T
    tip += L1 * np.array([np.cos(q[:, 0]), np.sin(q[:, 0])]).T
    file = made.save(folder / f"{name}_motion") / "trajectory.json"
    return file, bool(made.to_dict()["certified"]), tip


def logged(
    arm: steelyard.LoadedRobot,
    target: Path,
    truth: Path,
    periods: int,
    rng: np.random.Generator,
    seed: int,
) -> str:
    """A log of reaches with torque noise; without standstill, first and last period."""
    motion = target.with_name(f"{target.name}_motion") / "trajectory.json"
    steelyard.simulate(arm, target, motion, periods=periods, rate=RATE, truth=truth, seed=seed)
    log = target / "log.csv"
    head = log.read_text(encoding="utf-8").splitlines()[0]
    rows = np.loadtxt(log, delimiter=",", skiprows=1)
    rows[:, -2:] += rng.standard_normal((len(rows), 2)) * NOISE
    np.savetxt(log, rows, "%.12g", ",", header=head, comments="")
    once = 8.0 * MOVE
    first, last = (1, periods - 1) if periods > 2 else (0, periods)
    return f"{log}@{1.0 + first * once:g}:{1.0 + last * once:g}"


def samples(folder: Path, prepared: str, log: str) -> Samples:
    """A log as columns of eq. 13, by the signals that are prepared so."""
    laws = sorted({law for laws in TERMS.values() for law in laws})
    robot = robot_file("p5_arm", folder / "columns.toml", tables(prepared) + terms(laws))
    (found,) = steelyard.load_runs(robot, log)
    data, model = found.whole(), steelyard.model_of(robot)
    nominal = model.prior
    assert nominal is not None  # the URDF has all masses
    every = nominal.regressor(data.motion)
    columns = {
        size: every[:, :, [model.names.index(name) for name in names(size)]]
        / np.where(np.arange(size) == 1, L1, 1.0)
        for size in TERMS
    }
    return Samples(data.t, columns, data.effort)


def terms(laws: Sequence[str]) -> str:
    """Bodies and friction laws, as a table of the robot file."""
    return f"\n[model]\nterms = {json.dumps(['rigid_body', *laws])}\n"


def identified(
    folder: Path, name: str, size: int, prepared: str, logs: dict[str, str]
) -> steelyard.Identification:
    """A model from the reaches to targets 1 to 4."""
    changes = tables(prepared) + terms(TERMS[size]) + RULED
    robot = robot_file("p5_arm", folder / f"{name}.toml", changes)
    return steelyard.identify(robot, logs["identification"], check=False, threads=1)


def own_values(model: steelyard.IdentifiedModel, size: int) -> Array:
    """Identified parameters as eq. 14 has them."""
    known = model.estimate.parameters.as_dict()
    return np.array([known[name] for name in names(size)]) * np.where(np.arange(size) == 1, L1, 1)


def least_squares(columns: Array, effort: Array, seed: int = 0) -> Array:
    """Eq. 20."""
    return np.asarray(np.linalg.solve(columns.T @ columns, columns.T @ effort))


def constrained(columns: Array, effort: Array, seed: int = 0) -> Array:
    """The same with no parameter below zero; exact."""
    root = np.linalg.cholesky(columns.T @ columns)
    return np.asarray(nnls(root.T, np.linalg.solve(root, columns.T @ effort))[0])


def genetic(columns: Array, effort: Array, seed: int, again: bool = True) -> Array:
    """The paper's steps 1 to 10: crossover, mutation, after each the best of old and new.

    What it does not print is assumed: tournaments of two, blends of two parents, normal mutations
    that become smaller from generation to generation.

    Args:
        columns: Shape `(N, p)`.
        effort: Shape `(N,)` [Nm].
        seed: Of all random choices.
        again: Whether fitness is calculated for old individuals too, as steps 2, 6 and 8 say (150
            times a generation), or for new ones alone (60 times).

    Returns:
        The best individual, shape `(p,)`.
    """
    rng = np.random.default_rng(seed)
    size = (INDIVIDUALS, columns.shape[1])

    def errors(genes: Array) -> Array:
        return np.asarray(np.sqrt(np.mean((effort - genes @ columns.T) ** 2, axis=1)))

    def best(genes: Array, cost: Array, offspring: Array) -> tuple[Array, Array]:
        genes = np.concatenate([genes, np.clip(offspring, 0.0, 1.0)])
        cost = errors(genes) if again else np.concatenate([cost, errors(genes[INDIVIDUALS:])])
        kept = np.argsort(cost)[:INDIVIDUALS]
        return genes[kept], cost[kept]

    genes = rng.random(size)
    cost = errors(genes)
    for generation in range(GENERATIONS):
        drawn = rng.integers(INDIVIDUALS, size=(2, 2, INDIVIDUALS))
        one, other = genes[drawn.min(axis=1)]  # individuals are sorted after the first generation
        share = rng.uniform(-0.5, 1.5, size) * (rng.random((INDIVIDUALS, 1)) < CROSSOVER)
        genes, cost = best(genes, cost, one + share * (other - one))
        step = STEP * (1.0 - generation / GENERATIONS) ** 2
        change = step * rng.standard_normal(size) * (rng.random(size) < MUTATION)
        genes, cost = best(genes, cost, genes + change)
        cost = errors(genes) if again else cost
    return np.asarray(genes[0])


def times(columns: Array, effort: Array) -> tuple[float, float]:
    """Processor time of the genetic algorithm over that of constrained least squares, same rows.

    Returns:
        Of the algorithm as printed, and of one that calculates no fitness twice.
    """
    linear = min(cpu(lambda: constrained(columns, effort)) for _ in range(50))
    printed = min(cpu(lambda: genetic(columns, effort, 0)) for _ in range(3))
    less = min(cpu(lambda: genetic(columns, effort, 0, again=False)) for _ in range(3))
    return printed / linear, less / linear


def cpu(work: Callable[[], object]) -> float:
    """Processor time [s]."""
    start = time.process_time()
    work()
    return time.process_time() - start


def indefinite(values: Sequence[float]) -> float:
    """Share of the circle on which the mass matrix of inertial parameters is indefinite."""
    angle = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
    squares = CENTRE**2 + RADIUS**2 + 2.0 * CENTRE * RADIUS * np.sin(angle)
    cosine = (squares - L1**2 - L2**2) / (2.0 * L1 * L2)
    return float(np.mean(values[0] * values[2] < (values[1] * cosine) ** 2))


def worst(found: Sequence[Found], compared: Callable[[Found, int], float]) -> list[float]:
    """The larger one of two comparisons, 9 and 11 parameters, by seed."""
    return [max(compared(one, size) for size in (9, 11)) for one in found]


def page(found: Sequence[Found]) -> Page:
    """Tables, pictures and bounds."""
    last = [one.tip["ours", LAWS[2]] for one in found]
    close = worst(found, lambda f, n: f.training["constrained", n] / f.training["genetic", n])
    fresh = worst(
        found,
        lambda f, n: float((f.errors["constrained", n] / f.errors["genetic", n]).max()),
    )
    fall = [float((f.errors["ours", 11] / f.errors["least squares", 7]).max()) for f in found]
    singular = [indefinite(PRINTED[size]) for size in TERMS]
    possible = [indefinite(f.values["ours", 11].tolist()) for f in found]
    slow = [min(one.ratio[9][0], one.ratio[11][0]) for one in found if not one.quick]
    claims: tuple[Claim, ...] = (
        Claim("tip on the circle, RMS, every seed", over_seeds(last, "mm"), "<= 1 mm",
              max(last) <= 1.0),
        Claim("constrained least squares over genetic algorithm, identification, every seed",
              over_seeds(close, digits=4), "<= 1.01", max(close) <= 1.01),
        Claim("the same, validation, worse joint, every seed",
              over_seeds(fresh, digits=4), "<= 1.01", max(fresh) <= 1.01),
        Claim("our error with 11 over least squares with 7, worse joint, every seed",
              over_seeds(fall), "< 1", max(fall) < 1.0),
        Claim("printed inertias: share of the circle with an indefinite mass matrix",
              ", ".join(f"{100.0 * share:.0f} %" for share in singular),
              "> 0 (tables II, IV, III)", min(singular) > 0.0),
        Claim("the same of the identified ones, every seed", over_seeds(possible), "0",
              max(possible) == 0.0),
        Claim("limits of the three motions proven",
              f"{sum(one.certified for one in found)} of {len(found)} seeds", "all",
              all(one.certified for one in found)),
    )  # fmt: skip
    if slow:
        timed = Claim("processor time, genetic algorithm over constrained least squares, median",
                      over_seeds(slow, digits=4), ">= 1000",
                      float(np.median(slow)) >= 1000.0)  # fmt: skip
        claims = (*claims, timed)
    first = found[0]
    parts: tuple[Part, ...] = (
        STORY,
        path_picture(first),
        *(values_table(first, size) for size in TERMS),
        inertia_table(),
        Text("Errors", ERRORS),
        error_table(found),
        linear_table(found),
        torque_picture(first),
        Text("Computed torque on the circle", CONTROL),
        circle_table(found),
        circle_picture(first),
    )
    return Page("A five-bar arm: least squares, genetic algorithm, computed torque", parts, claims)


STORY = Text(
    "",
    (
        "Wang et al. identify a rehabilitation arm with a genetic algorithm, as friction differs "
        "by direction. Here a simulated five-bar arm takes its place, closed by its loop. For "
        "every seed it has other masses and other friction (table III, every value changed by up "
        "to 20 %); no estimator sees them, nor the masses of the model file.",
        "Assumed, as the paper does not print it: bars of 0.3 and 0.4 m, masses, reaches of 1.2 s "
        "without standstill, a zero-phase torque filter of fourth order at 10 Hz, noise of the "
        "Kalman filter by maximum likelihood, encoders of 17 bits, torque noise of 0.03 and 0.09 "
        "Nm, mutation and crossover of the genetic algorithm. Table I's joint ranges are wider "
        "here, as the circle needs -27 to 61 and 104 to 167 degrees with these bars.",
        "Different from the paper: six periods instead of ten, of which the first and the last are "
        "left out as well. The paper's inertias (tables II to IV) belong to no arm, as φ1·φ3 < "
        "φ2², so the simulated arm has possible ones. Friction by direction is linear in its "
        "parameters, so least squares applies to 9 and 11 parameters as well as to 7.",
    ),
)

ERRORS = (
    "Root mean square of measured minus predicted torque on reaches to targets 5 to 8 (eq. 25), "
    "torques behind the zero-phase filter. The paper's method: Kalman filter, then least squares "
    "(7 parameters) or its genetic algorithm (9 and 11: 30 individuals, 100 generations). "
    "Its steps 2, 6 and 8 calculate the fitness of all individuals, of old ones too; the last "
    "column of the second table is of an algorithm that does not. Constrained: least squares on "
    "the same rows, no parameter below zero. Ours: Kalman smoother, "
    "regressor and torque behind the same filter, joints weighted by their residuals, bodies that "
    "can exist, dissipative friction. With 9 parameters it is not better in every seed.",
)

CONTROL = (
    "The tip follows the circle of eq. 26 (radius 0.2 m, 7.2 s) after a ramp of 1 s; encoders, "
    "delay and lag lie between the controller and the joints; the whole motion counts. Kp = 100 "
    f"and Kv = 5 are a damping ratio of Kv / (2 √Kp) = {KV / (2.0 * KP**0.5):.2f}; without "
    "overshoot Kv would be 20. Eq. 29 leaves out the friction that the paper has just identified: "
    "with it the error falls. Eq. 28 prints -Kv ė - Kp e where eq. 29 has plus, which is right. "
    "The paper's model is that of its 9 parameters, by least squares on its signals, which "
    "the genetic algorithm approaches.",
)


def values_table(first: Found, size: int) -> Table:
    """Tables II to IV of the first seed."""
    method = "least squares" if size == 7 else "genetic"
    truth = first.truth if size == 11 else (*first.truth[:3], *(np.nan,) * (size - 3))
    rows = tuple(
        (name, f"{printed:.4f}", f"{theirs:.4f}", f"{ours:.4f}", f"{true:.4f}".replace("nan", "–"))
        for name, printed, theirs, ours, true in zip(
            labels(size), PRINTED[size], first.values[method, size], first.values["ours", size],
            truth, strict=True,
        )
    )  # fmt: skip
    columns = ("", "paper (another arm)", "the paper's method here", "ours", "truth")
    return Table(f"{size} parameters (table {TABLES[size]}), first seed", rows, columns)


def inertia_table() -> Table:
    """What the printed inertias are of."""
    rows = tuple(
        (
            f"table {TABLES[size]}",
            f"{p[0] * p[2]:.5f}",
            f"{p[1] ** 2:.5f}",
            f"{p[1]:.4f}",
            f"{(p[0] * p[2]) ** 0.5:.4f}",
            f"{100.0 * indefinite(p):.0f} %",
        )
        for size, p in PRINTED.items()
    )
    columns = (
        "", "φ1 φ3", "φ2²", "φ2 as printed", "largest possible φ2",
        "circle with indefinite mass matrix",
    )  # fmt: skip
    return Table("Printed inertias: every arm has φ2² < φ1 φ3", rows, columns)


def error_table(found: Sequence[Found]) -> Table:
    """Table V."""
    rows = tuple(
        (f"{size} parameters, joint {joint + 1}", PRINTED_ERRORS[size][joint])
        + tuple(
            over_seeds([one.errors[method, size][joint] for one in found])
            for method in ("least squares" if size == 7 else "genetic", "constrained", "ours")
        )
        for size in TERMS
        for joint in (0, 1)
    )
    columns = ("", "paper", "the paper's method here", "constrained least squares", "ours")
    return Table("Validation error (table V) [Nm]", rows, columns)


def linear_table(found: Sequence[Found]) -> Table:
    """Least squares beside the genetic algorithm on the same rows."""
    rows = []
    for size in TERMS:
        errors = (
            over_seeds([one.training[method, size] for one in found], digits=4)
            for method in ("genetic", "least squares", "constrained")
        )
        times = [[one.ratio[size][k] for one in found if not one.quick] for k in (0, 1)]
        rows.append(
            (f"{size} parameters", *errors)
            + tuple(over_seeds(own, digits=4) if own else "full runs" for own in times)
        )
    columns = (
        "", "genetic algorithm", "least squares", "constrained",
        "time, genetic over constrained", "the same, no fitness calculated twice",
    )  # fmt: skip
    return Table("Error on the identification reaches, same rows [Nm]", tuple(rows), columns)


def circle_table(found: Sequence[Found]) -> Table:
    """Fig. 7."""
    rows = tuple(
        (
            law,
            "only pictures" if law == LAWS[1] else "not examined",
            *(
                over_seeds(known) if known else "full runs"
                for model in ("paper", "ours")
                for known in [[f.tip[model, law] for f in found if (model, law) in f.tip]]
            ),
        )
        for law in LAWS
    )
    return Table("Deviation of the tip from the circle, RMS [mm]", rows)


def path_picture(first: Found) -> Picture:
    """Fig. 3."""
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    curves = (
        Curve("reaches", first.path[:, 0], first.path[:, 1], colour=0),
        Curve("circle", RADIUS * np.cos(angle), CENTRE + RADIUS * np.sin(angle), colour=4),
    )
    panel = Panel("Path of the tip", "x [m]", "y [m]", curves, square=True)
    caption = "Reaches from the centre to eight targets (fig. 3), and the circle of eq. 26."
    return Picture("path", caption, (panel,), columns=1)


def torque_picture(first: Found) -> Picture:
    """Figs. 4 and 5."""
    once = round(8.0 * MOVE * RATE)
    drawn = tuple(zip(("measured", "least squares, 7", "ours, 11"), first.traces, strict=True))
    panels = tuple(
        Panel(
            f"joint {k + 1}",
            "time [s]",
            "Nm",
            tuple(
                Curve(name, t[:once], torque[:once, k], colour=colour)
                for (name, (t, torque)), colour in zip(drawn, (4, 1, 0), strict=True)
            ),
        )
        for k in (0, 1)
    )
    caption = (
        "Measured torques of one period of the validation reaches, first seed, and predictions by "
        "the paper's least squares with 7 parameters (fig. 4) and ours with 11 (fig. 5)."
    )
    return Picture("torques", caption, panels)


def circle_picture(first: Found) -> Picture:
    """Fig. 7."""
    t, *deviations = first.circle
    curves = tuple(
        Curve(name, t, deviation, colour=colour)
        for name, deviation, colour in zip(
            ("PD", "eq. 29", "with friction"), deviations, (4, 1, 0), strict=True
        )
    )
    panel = Panel("tip", "time [s]", "deviation [mm]", curves)
    caption = "Deviation of the tip from the circle, first seed, our model (fig. 7)."
    return Picture("circle", caption, (panel,), columns=1)


STUDY = Study("p5", one, page)

if __name__ == "__main__":
    run(STUDY)
