"""Study p5: a five-bar arm, least squares beside a genetic algorithm, computed torque [WangC].

The paper identifies a rehabilitation arm, a parallelogram with two motors on one axis, from
minimum-jerk reaches to eight targets at 50 Hz: least squares with 7 parameters, a genetic algorithm
with 9 and 11, as friction differs by direction. The tip then follows a circle under PD computed
torque.

    python studies/p5_five_bar.py -o DIR [--quick] [--seeds N]

For every seed another arm, whose parameters no estimator sees, reaches to targets 1 to 4
(identification) and 5 to 8 (validation) under PID control with drives whose torque ends at the
motors' 844 mNm, and follows the circle under each law.
"""

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.signal import lfilter

sys.path.append(str(Path(__file__).parents[1]))
from studies.support.measured import HEADING
from studies.support.page import Claim, Page, Part, Table, Text, over_seeds
from studies.support.picture import Curve, Panel, Picture
from studies.support.robots import ROBOTS, robot_file
from studies.support.study import Study, run

import steelyard

Array = NDArray[np.float64]

L1, L2, CENTRE, RADIUS = 0.3, 0.4, 0.4, 0.2
"""Bars, and the circle of targets, which is that of eq. 26 [m]."""

RATE, MOVE, PERIODS = 50.0, 1.2, 10
"""Rows per second, time of a reach [s]; periods, of which the first and the last are left out."""

KP, KV = 100.0, 5.0
NOISE, REMEMBERED = (0.03, 0.09), 0.98
"""Noise of the logged torques at the joints [Nm], of the size of the paper's best residuals; and of
coloured noise the correlation from row to row: a first-order process of 1 s."""

RATIO, MOTOR = 5.0, 0.844
"""Table I: belt, and greatest torque of a motor [Nm]."""

REACHING = "pid"
"""Of the reaches: gains by the inertia, as the paper prints none."""

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

INDIVIDUALS, GENERATIONS = 30, 100
"""Of the genetic algorithm."""

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
matched_cutoff = "off"
rest_speed = "off"
[estimation]
method = "least_squares"
weights = "equal"
"""
"""The paper's signals: zero-phase torque filter, Kalman filter; least squares as printed."""

GENETIC = f"""
[estimation]
method = "genetic"
[estimation.genetic]
population = {INDIVIDUALS}
generations = {GENERATIONS}
seed = {{seed}}
""" + "".join(
    f"""
[[knowledge]]
kind = "parameter"
parameter = "{name}.*"
lower = 0.0
upper = {upper}
"""
    for name, upper in (("m", 2.0), ("mx", 1.0), ("Izz", 0.3))
)
"""The genetic algorithm, and bounds of the bodies from which those of eq. 14 follow: up to 0.8, 0.7
and 0.9 kg m². The paper prints none."""

FRICTION_BOUND = 1.0
"""Greatest value of each friction parameter in the search [Nm; Nm s]."""

SMOOTHED = """
[processing]
motion = "kalman"
effort = { method = "butterworth", cutoff = 10.0 }
"""
"""The same with the smoother: its accelerations are not late."""

METHODS = ("least squares", "constrained", "genetic")

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
        values: Parameters by method and number of them, in the order of `names`.
        truth: The true ones, 11.
        errors: Validation error of each joint, likewise [Nm].
        training: Error of all samples of the identification (eq. 24), likewise [Nm].
        coloured: The same as `values`, of the same reaches with coloured noise.
        peak: Greatest torque of the motors during the reaches, over their limit.
        certified: Whether the three motions keep all limits.
        tip: RMS deviation of the tip from the circle by model and law [mm]; a quick study has those
            of our model alone.
        circle: Time [s] and errors of x and y, shape `(N, 2)` [mm], of our model's laws, in the
            order of `LAWS`.
        traces: Time and torques of validation: measured, by least squares with 7 parameters, by
            the genetic algorithm with 11.
        history: By number of parameters: best and mean error of each generation [Nm].
        path: Tip on the way to all targets, shape `(N, 2)` [m].
    """

    values: dict[tuple[str, int], Array]
    truth: Array
    errors: dict[tuple[str, int], Array]
    training: dict[tuple[str, int], float]
    coloured: dict[tuple[str, int], Array]
    peak: float
    certified: bool
    tip: dict[tuple[str, str], float]
    circle: tuple[Array, ...]
    traces: tuple[tuple[Array, Array], ...]
    history: dict[int, tuple[Array, Array]]
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
    periods = 3 if quick else PERIODS
    logs = {
        name: logged(arm, folder / name, truth, periods, rng, seed)
        for name in ("identification", "validation")
    }
    logs["coloured"] = recoloured(logs["identification"], rng)
    filtered, smoothed = (
        {name: samples(folder, prepared, log) for name, log in logs.items()}
        for prepared in (FILTERED, SMOOTHED)
    )
    values, history = printed(folder, filtered["identification"], logs["identification"], seed)
    coloured, _ = printed(folder, filtered["coloured"], logs["coloured"], seed)
    ours = {
        size: identified(folder, f"ours{size}", size, SMOOTHED, logs["identification"])
        for size in TERMS
    }
    values |= {("ours", size): own_values(made.model, size) for size, made in ours.items()}
    data = {method: filtered for method, _ in values} | {"ours": smoothed}
    models = [ours[11].save(folder / "ours_11")]
    if not quick:
        models.append(
            identified(folder, "paper", 9, FILTERED, logs["identification"]).save(
                folder / "paper_9"
            )
        )
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
    seen = filtered["validation"]
    torques = [np.abs(filtered[name].effort).max() for name in ("identification", "validation")]
    return Found(
        values,
        true_values(truth),
        {key: data[key[0]]["validation"].errors(v) for key, v in values.items()},
        {
            key: float(np.sqrt(np.mean(data[key[0]]["identification"].errors(v) ** 2)))
            for key, v in values.items()
        },
        coloured,
        float(max(torques)) / (RATIO * MOTOR),
        all(certified for _, certified, _ in motions.values()),
        {
            (name, law): 1e3 * run.tool_rms
            for name, own in runs.items()
            for law, run in zip(LAWS, own, strict=True)
        },
        (
            tracked.t,
            *(1e3 * (tracked.desired - run.tool)[:, :2] for run in runs["ours"]),
        ),
        (
            (seen.t, seen.effort),
            (seen.t, seen.columns[7] @ values["least squares", 7]),
            (seen.t, seen.columns[11] @ values["genetic", 11]),
        ),
        history,
        np.concatenate([motions[name][2] for name in ("identification", "validation")]),
    )


def printed(
    folder: Path, rows: Samples, log: str, seed: int
) -> tuple[dict[tuple[str, int], Array], dict[int, tuple[Array, Array]]]:
    """The paper's methods on one log, and constrained least squares on the same rows.

    Returns:
        Parameters as of `Found`, and the history of the genetic algorithm.
    """
    values, history = dict[tuple[str, int], Array](), dict[int, tuple[Array, Array]]()
    for size in TERMS:
        values["least squares", size] = least_squares(*rows.rows(size))
        values["constrained", size] = constrained(*rows.rows(size))
        friction = "".join(
            f'''
[[knowledge]]
kind = "parameter"
parameter = "{law}*"
lower = 0.0
upper = {FRICTION_BOUND}
'''
            for law in TERMS[size]
        )
        prepared = FILTERED.partition("[estimation]")[0] + GENETIC.format(seed=seed) + friction
        made = identified(folder, f"genetic{size}", size, prepared, log).model
        search = made.estimate.evolution
        assert search is not None  # the method is the genetic algorithm
        values["genetic", size] = own_values(made, size)
        history[size] = (search.best, search.mean)
    return values, history


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
    """A log of reaches with white torque noise; without standstill, first and last period."""
    motion = target.with_name(f"{target.name}_motion") / "trajectory.json"
    steelyard.simulate(
        arm, target, motion, periods=periods, rate=RATE, truth=truth, control=REACHING, seed=seed
    )
    log, exact, once = target / "log.csv", target / "exact.csv", 8.0 * MOVE
    log.rename(exact)
    with_noise(exact, log, lambda shape: rng.standard_normal(shape))
    return f"{log}@{1.0 + once:g}:{1.0 + (periods - 1) * once:g}"


def recoloured(log: str, rng: np.random.Generator) -> str:
    """The same reaches with coloured torque noise of the same standard deviation."""
    path, _, window = log.partition("@")
    other = Path(path).with_name("coloured.csv")

    def coloured(shape: tuple[int, int]) -> Array:
        drawn = rng.standard_normal(shape)
        drawn[1:] *= (1.0 - REMEMBERED**2) ** 0.5
        return np.asarray(lfilter([1.0], [1.0, -REMEMBERED], drawn, axis=0))

    with_noise(Path(path).with_name("exact.csv"), other, coloured)
    return f"{other}@{window}"


def with_noise(exact: Path, target: Path, drawn: Callable[[tuple[int, int]], Array]) -> None:
    """Write a log with noise of the motors' torques, drawn with a standard deviation of one."""
    head = exact.read_text(encoding="utf-8").splitlines()[0]
    rows = np.loadtxt(exact, delimiter=",", skiprows=1)
    names = head.split(",")
    torques = [k for k, name in enumerate(names) if name.startswith("motor_tau")]
    rows[:, torques] += drawn((len(rows), 2)) * NOISE / RATIO
    np.savetxt(target, rows, "%.12g", ",", header=head, comments="")


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
    return Samples(data.t, columns, RATIO * data.effort)


def terms(laws: Sequence[str]) -> str:
    """Bodies and friction laws, as a table of the robot file."""
    return f"\n[model]\nterms = {json.dumps(['rigid_body', *laws])}\n"


def identified(
    folder: Path, name: str, size: int, prepared: str, log: str
) -> steelyard.Identification:
    """A model from the reaches to targets 1 to 4."""
    changes = tables(prepared) + terms(TERMS[size]) + RULED
    robot = robot_file("p5_arm", folder / f"{name}.toml", changes)
    return steelyard.identify(robot, log, check=False, threads=1)


def own_values(model: steelyard.IdentifiedModel, size: int) -> Array:
    """Identified parameters as eq. 14 has them."""
    known = model.estimate.parameters.as_dict()
    return np.array([known[name] for name in names(size)]) * np.where(np.arange(size) == 1, L1, 1)


def least_squares(columns: Array, effort: Array) -> Array:
    """Eq. 20."""
    return np.asarray(np.linalg.solve(columns.T @ columns, columns.T @ effort))


def constrained(columns: Array, effort: Array) -> Array:
    """The same with no parameter below zero; exact."""
    root = np.linalg.cholesky(columns.T @ columns)
    return np.asarray(nnls(root.T, np.linalg.solve(root, columns.T @ effort))[0])


def indefinite(values: Sequence[float]) -> float:
    """Share of the circle on which the mass matrix of inertial parameters is indefinite."""
    angle = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
    squares = CENTRE**2 + RADIUS**2 + 2.0 * CENTRE * RADIUS * np.sin(angle)
    cosine = (squares - L1**2 - L2**2) / (2.0 * L1 * L2)
    return float(np.mean(values[0] * values[2] < (values[1] * cosine) ** 2))


def worst(found: Sequence[Found], compared: Callable[[Found, int], float]) -> list[float]:
    """The larger one of two comparisons, 9 and 11 parameters, by seed."""
    return [max(compared(one, size) for size in (9, 11)) for one in found]


def astray(values: dict[tuple[str, int], Array], truth: Array, method: str) -> float:
    """Largest error of the three inertial parameters, relative to the truth, 11 parameters."""
    return float(np.max(np.abs(values[method, 11][:3] / truth[:3] - 1.0)))


def page(found: Sequence[Found]) -> Page:
    """Tables, pictures and bounds."""
    last = [one.tip["ours", LAWS[2]] for one in found]
    close = worst(found, lambda f, n: f.training["genetic", n] / f.training["constrained", n])
    fresh = worst(
        found,
        lambda f, n: float((f.errors["constrained", n] / f.errors["genetic", n]).max()),
    )
    fall = [float((f.errors["ours", 11] / f.errors["least squares", 7]).max()) for f in found]
    singular = [indefinite(PRINTED[size]) for size in TERMS]
    claims: tuple[Claim, ...] = (
        Claim("tip on the circle, RMS, every seed", over_seeds(last, "mm"), "<= 1 mm",
              max(last) <= 1.0),
        Claim("genetic algorithm over constrained least squares, identification, every seed",
              over_seeds(close, digits=4), "<= 1.01", max(close) <= 1.01),
        Claim("constrained least squares over genetic algorithm, validation, worse joint, every "
              "seed", over_seeds(fresh, digits=4), "<= 1.01", max(fresh) <= 1.01),
        Claim("our error with 11 over least squares with 7, worse joint, every seed",
              over_seeds(fall), "< 1", max(fall) < 1.0),
        Claim("printed inertias: share of the circle with an indefinite mass matrix",
              ", ".join(f"{100.0 * share:.0f} %" for share in singular),
              "> 0 (tables II, IV, III)", min(singular) > 0.0),
        Claim("limits of the three motions proven",
              f"{sum(one.certified for one in found)} of {len(found)} seeds", "all",
              all(one.certified for one in found)),
    )  # fmt: skip
    first = found[0]
    parts: tuple[Part, ...] = (
        verdicts(found),
        STORY,
        path_picture(first),
        reach_table(found),
        *(values_table(first, size) for size in TERMS),
        inertia_table(),
        Text("Errors", ERRORS),
        error_table(found),
        linear_table(found),
        evolution_picture(first),
        *(
            torque_picture(first, *which)
            for which in (
                ("least-squares", 1, "7", "fig. 4"),
                ("genetic-algorithm", 2, "11", "fig. 5"),
            )
        ),
        Text("Coloured noise", NOISES),
        noise_table(found),
        Text("Computed torque on the circle", CONTROL),
        circle_table(found),
        circle_picture(first),
        Text(HEADING, ("There is no public log of a measured five-bar arm.",)),
    )
    return Page("A five-bar arm: least squares, genetic algorithm, computed torque", parts, claims)


def verdicts(found: Sequence[Found]) -> Table:
    """What the paper claims, and whether it holds here."""

    def fall(method: str, size: int) -> list[float]:
        seven = ("least squares", 7)
        return [float((f.errors[method, size] / f.errors[seven]).max()) for f in found]

    better = max(fall("genetic", 11)) < 1.0
    alone = min(a / b for a, b in zip(fall("least squares", 11), fall("genetic", 11), strict=True))
    white, coloured = (
        {m: [astray(v, f.truth, m) for f, v in of] for m in ("least squares", "genetic")}
        for of in ([(f, f.values) for f in found], [(f, f.coloured) for f in found])
    )
    gain = [g / ls for g, ls in zip(coloured["genetic"], coloured["least squares"], strict=True)]
    nine = [float((f.errors["genetic", 9] / f.errors["genetic", 11]).max()) for f in found]
    eq29 = [f.tip["ours", LAWS[1]] for f in found]
    friction = [f.tip["ours", LAWS[2]] / f.tip["ours", LAWS[1]] for f in found]
    biased = np.median(coloured["least squares"]) > 2.0 * np.median(white["least squares"])
    rows = (
        (
            "the genetic algorithm is significantly more accurate than least squares",
            "no" if not better else "partly" if alone < 1.05 else "yes",
            f"validation error with 11 parameters over least squares with 7, worse joint: genetic "
            f"algorithm {over_seeds(fall('genetic', 11))}, least squares with the same 11 "
            f"{over_seeds(fall('least squares', 11))}: the friction by direction reduces it, not "
            "the algorithm",
        ),
        (
            "with coloured noise least squares is biased, the genetic algorithm better",
            "yes" if biased and np.median(gain) < 0.8 else "partly" if biased else "no",
            f"largest error of an inertia, genetic algorithm over least squares: "
            f"{over_seeds(gain)}; least squares: {over_seeds(white['least squares'])} with white, "
            f"{over_seeds(coloured['least squares'])} with coloured noise",
        ),
        (
            "one viscous parameter for both directions suffices (9 instead of 11)",
            "yes" if np.median(nine) < 1.1 else "partly" if min(nine) < 1.1 else "no",
            f"validation error with 9 over that with 11, worse joint: {over_seeds(nine)}",
        ),
        (
            "computed torque with the identified model follows the circle",
            "yes" if max(eq29) < 5.0 else "partly" if max(eq29) < 20.0 else "no",
            f"deviation of the tip: {over_seeds(eq29, 'mm')}; with the identified friction, which "
            f"eq. 29 leaves out, times {over_seeds(friction)}",
        ),
        (
            "the inertias of tables II to IV are those of the arm",
            "no",
            "φ1 φ3 < φ2² in all three: the mass matrix is indefinite on a part of the circle",
        ),
    )
    columns = ("the paper", "holds here", "figure")
    return Table("What the paper claims, and whether it holds here", rows, columns)


STORY = Text(
    "",
    (
        "Wang et al. identify a rehabilitation arm with a genetic algorithm, as friction differs "
        "by direction. Here a simulated five-bar arm takes its place, closed by its loop, under "
        "PID control with encoders, delay and lag, and with motors of 844 mNm behind belts of 5:1 "
        "(table I). Ten periods of each motion are logged, the first and the last left out. For "
        "every seed the arm has other masses and other friction (table III, every value changed by "
        "up to 20 %); no estimator sees them, nor the masses of the model file.",
        "Assumed, as the paper does not print it: bars of 0.3 and 0.4 m, masses, reaches of 1.2 s "
        "without standstill, gains of the PID control, a zero-phase torque filter of fourth order "
        "at 10 Hz, noise of the Kalman filter by maximum likelihood, encoders of 17 bits, torque "
        "noise of 0.03 and 0.09 Nm at the joints, bounds, mutation and crossover of the genetic "
        "algorithm. Table I's joint ranges are wider here, as the circle needs -27 to 61 and 104 "
        "to 167 degrees with these bars.",
        "Different from the paper: its inertias (tables II to IV) belong to no arm, as φ1·φ3 < "
        "φ2², so the simulated arm has possible ones. Friction by direction is linear in its "
        "parameters, so least squares applies to 9 and 11 parameters as well as to 7.",
    ),
)

NOISES = (
    f"The same reaches with noise of the same standard deviation whose correlation from row to row "
    f"is {REMEMBERED}, as slow disturbances have. The genetic algorithm minimises the squares that "
    "least squares minimises, so the noise moves both alike: eq. 24 has no term that would take "
    "the colour out.",
)

ERRORS = (
    "Root mean square of measured minus predicted torque on reaches to targets 5 to 8 (eq. 25), "
    "torques behind the zero-phase filter. The paper's method: Kalman filter, all samples, then "
    "least squares as printed (eq. 20; 7 parameters) or its genetic algorithm (9 and 11: 30 "
    'individuals, 100 generations; here with steelyard\'s estimator "genetic"). Constrained: least '
    "squares on the same rows, no parameter below zero; exact in one step. Ours: Kalman smoother, "
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


def reach_table(found: Sequence[Found]) -> Table:
    """The reaches and their motors."""
    peaks = over_seeds([100.0 * one.peak for one in found], "%")
    rows = (
        ("control", "PID", "PID"),
        ("periods; left out", "10; first and last", "10; first and last (quick: 3)"),
        ("greatest measured torque of a motor, of 844 mNm", "not printed", peaks),
    )
    return Table("The reaches", rows, ("", "paper", "here"))


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
    rows = tuple(
        (f"{size} parameters",)
        + tuple(
            over_seeds([one.training[method, size] for one in found], digits=4)
            for method in ("genetic", "least squares", "constrained")
        )
        + (
            over_seeds(
                [f.training["genetic", size] / f.training["constrained", size] for f in found],
                digits=4,
            ),
        )
        for size in TERMS
    )
    columns = ("", "genetic algorithm", "least squares", "constrained", "genetic / constrained")
    return Table("Error on the identification reaches, same rows [Nm]", rows, columns)


def noise_table(found: Sequence[Found]) -> Table:
    """Errors of the parameters by the colour of the noise."""
    rows = tuple(
        (name, *(over_seeds([100.0 * astray(v, f.truth, m) for f, v in of], "%") for m in METHODS))
        for name, of in (
            ("white noise", [(f, f.values) for f in found]),
            ("coloured noise", [(f, f.coloured) for f in found]),
        )
    )
    return Table("Largest error of an inertial parameter, 11 parameters", rows, ("", *METHODS))


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


def evolution_picture(first: Found) -> Picture:
    """The genetic algorithm over its generations."""
    panels = tuple(
        Panel(
            f"{size} parameters",
            "generation",
            "root mean square error [Nm]",
            (
                Curve("mean", np.arange(1, len(best) + 1), mean, colour=4),
                Curve("best", np.arange(1, len(best) + 1), best, colour=0),
                Curve(
                    "constrained least squares",
                    [1, len(best)],
                    [first.training["constrained", size]] * 2,
                    colour=1,
                ),
            ),
            log=True,
        )
        for size, (best, mean) in first.history.items()
    )
    caption = (
        "Best and mean error (eq. 24) of the individuals over the generations, first seed, and "
        "the exact optimum."
    )
    return Picture("evolution", caption, panels)


def torque_picture(first: Found, name: str, trace: int, size: str, printed: str) -> Picture:
    """Figs. 4 and 5."""
    once = round(8.0 * MOVE * RATE)
    (t, measured), (_, predicted) = first.traces[0], first.traces[trace]
    shown = (measured, predicted, measured - predicted)
    panels = tuple(
        Panel(
            f"joint {k + 1}",
            "time [s]",
            "Nm",
            tuple(
                Curve(label, t[:once], torque[:once, k], colour=colour)
                for label, torque, colour in zip(
                    ("measured", "estimated", "error"), shown, (4, 0, 1), strict=True
                )
            ),
        )
        for k in (0, 1)
    )
    caption = (
        f"Measured and estimated torques of one period of the validation reaches and their "
        f"difference, first seed, {name.replace('-', ' ')} with {size} parameters ({printed})."
    )
    return Picture(f"torques-{name}", caption, panels)


def circle_picture(first: Found) -> Picture:
    """Fig. 7."""
    t, *errors = first.circle
    panels = tuple(
        Panel(
            f"error of {axis}",
            "time [s]",
            "mm",
            tuple(
                Curve(name, t, error[:, k], colour=colour)
                for name, error, colour in zip(
                    ("PD", "eq. 29", "with friction"), errors, (4, 1, 0), strict=True
                )
            ),
        )
        for k, axis in enumerate("xy")
    )
    caption = "Errors of the tip on the circle along x and y, first seed, our model (fig. 7)."
    return Picture("circle", caption, panels)


STUDY = Study("p5", one, page)

if __name__ == "__main__":
    run(STUDY)
