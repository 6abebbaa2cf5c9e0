"""Study p3: consistent identification of six joints, and the wrench at the tool.

The paper identifies a Stäubli RX-160 from one Fourier motion within limits of the joints and of a
box: a convex program with consistent bodies beside ordinary least squares. Test motions follow,
then the wrench at the tool without a sensor: pushes by hand, and a load of 2 kg that is picked up.

    python studies/p3_consistent_wrench.py -o DIR [--quick] [--seeds N]

For every seed another arm, whose parameters no estimator sees, runs the designed motion, a poor one
of small range, a test motion that nothing was fitted to, one with pushes, and one with the load.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomlkit
from numpy.typing import NDArray

sys.path.append(str(Path(__file__).parents[1]))
from studies.support.measured import (
    AR5,
    EXAMPLES,
    HEADING,
    UR10E_PROCESS,
    errors_on,
    example,
    log,
    percent_table,
    ur10e,
)
from studies.support.measured import Errors as ErrorsOnLog
from studies.support.page import Claim, Page, Part, Section, Table, Text, over_seeds
from studies.support.picture import Curve, Panel, Picture
from studies.support.robots import ROBOTS, robot_file
from studies.support.study import Study, run

import steelyard

Array = NDArray[np.float64]

JOINTS = tuple(f"joint {k}" for k in range(1, 7))
COULOMB = (36.015, 60.694, 25.181, 9.041, 5.535, 0.254, 1.307)
VISCOUS = (154.055, 106.709, 16.508, 18.446, 21.600, 0.073, 5.043)
SPEED = (0.011, 0.011, 0.013, 0.012, 0.011, 0.012, 0.011)
STEEP = (3.2, 3.2, 3.2, 5.0, 5.0, 5.0, 5.0)
"""Convex column of table 4: of joints 1 to 6, then of the seventh coordinate q5 + q6."""

SPREAD, STICTION, SPRING = 0.2, 0.2, 200.0
"""Assumed: each friction value changes by up to SPREAD from seed to seed; static friction above
Coulomb's, relative to it; the true spring [Nm/rad]."""

LIGHT, HEAVY, BOXES = 0.3, 3.0, (0.3, 0.3, 0.3, 0.3, 0.1, 0.1)
"""Assumed bounds of the convex programs: masses from LIGHT to HEAVY times those of the robot file,
which are not the true ones; centres of mass within boxes of these half edges about its own [m]."""

POOR = 0.1
"""Range and speed of the poor motion, relative to the limits."""

PUSH, EVERY, LASTS, RAMP, LEVER = 30.0, 4.0, 2.0, 0.5, 0.1
"""Pushes [N], from one to the next, duration, rise and fall [s]; from the tool's origin [m]."""

LOAD, TOOL = 2.0, "link_6"
GRAVITY = np.array([0.0, 0.0, -9.81])
SENSOR = "fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm"
BIAS = np.array([12.0, -8.0, 20.0, 0.3, -0.5, 0.2])
SENSOR_NOISE = np.array([0.2, 0.2, 0.2, 0.01, 0.01, 0.01])
"""Columns, bias and noise of the force/torque sensor [N, Nm]; assumed."""

LIMITS = ((2.78, 3.49, 7.9), (1.5, 3.49, 6.5), (2.5, 4.45, 10.5),
          (4.0, 5.50, 25.2), (1.75, 6.80, 19.6), (4.40, 15.18, 41.7))  # fmt: skip
"""Table 2: positions either way [rad], speeds, accelerations."""

BOX = "box = { x = [-1.6, 1.6], y = [-1.6, 1.6], z = [0.3, 2.2] }"
"""Of the flange [m]; table 3 is not legible."""

PAPER_ERRORS = {
    "convex": (9.608, 18.919, 6.031, 0.992, 0.987, 0.388, 6.154),
    "OLS": (12.535, 13.639, 7.022, 2.789, 2.024, 1.657, 6.644),
}
PAPER_FRICTION = {
    "convex": (COULOMB, (3.653, -32.248, 11.738, -0.366, -0.663, 0.197, -0.065), VISCOUS),
    "OLS": (
        (78.596, 91.918, 53.838, 19.012, 3.172, -1.772, 3.966),
        (9798.862, 4723.866, 4637.736, 497.059, 303.847, 187.480, -29.863),
        (103.097, 78.488, -17.920, 9.038, 23.587, -0.291, 4.036),
    ),
}
"""Table 4: Coulomb, static and viscous friction."""

PAPER_DEVIATIONS = {
    "convex": (8.425, 13.538, 4.403, 0.870, 0.745, 0.357),
    "OLS": (9.899, 11.812, 4.940, 1.935, 1.622, 1.854),
}
"""Table 5 [Nm]; tables 6 and 7 are not legible."""

PRINTED_BODIES = (
    (54.332, -0.150, 0.0, 7e-7, 0.216, 0.0, 3e-4, 0.215, 0.0, -0.012),
    (39.966, -0.122, 0.699, -0.699, 48.358, -0.246, -9.813, 46.790, -3.710, 6.091),
    (10.007, -0.158, -0.300, 0.299, 8.646, -2.022, -1.212, 3.924, 0.609, 11.025),
    (10.013, 4.8e-5, -0.039, -0.122, 3.032, -0.181, 2.102, 4.440, 0.261, 1.442),
    (0.686, 0.107, -0.049, 0.105, 0.308, -0.085, 0.350, 0.716, 0.069, 0.435),
    (0.103, -0.050, 0.097, 0.074, 0.657, -0.053, 0.249, 0.684, 0.172, 0.212),
)
"""Convex column of table 4: mass, l, and six inertias in its order; that of link 5 from a cell with
all values of both columns."""

BODY = ("m [kg]", "lx", "ly", "lz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
NUMBERS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
"""Rows of a link in table 4 (m; kg m²), and parameters of a link."""

PLACES = (*(f"joint_{k}" for k in range(1, 7)), "wrist_gear")
LAWS = {"coulomb": "F_c", "stribeck": "F_s", "viscous": "F_v"}
METHODS, USED = ("OLS", "convex", "ours"), ("convex", "ours")
"""Least squares and the convex program, both as the paper has them; ours. Bodies and wrenches are
by the last two."""

SINGULAR = 100.0
"""Condition number of the Jacobian above which a posture counts as near-singular."""

MOTIONS = ("designed", "poor")
ESTIMATES = ("eq. 8, its model", "eq. 8, our model", "ours")
COMPONENTS = ("Fx [N]", "Fy [N]", "Fz [N]", "Mx [Nm]", "My [Nm]", "Mz [Nm]")


def terms(rotors: bool, stribeck: bool) -> list[str | dict[str, object]]:
    """Terms of a model: eqs. 5 to 7, the arctan of eq. 6 in place of the sign."""
    joints: dict[str, object] = {}
    wrist: dict[str, object] = {"along": {PLACES[6]: {"joint_5": 1.0, "joint_6": 1.0}}}
    widths = [round(1.0 / c, 4) for c in STEEP]
    made: list[str | dict[str, object]] = ["rigid_body", *(["rotor_inertia"] if rotors else [])]
    made += ["viscous", {"law": "viscous"} | wrist]
    for place, own in ((joints, slice(0, 6)), (wrist, slice(6, 7))):
        form = {"shape": "arctan", "smoothing": widths[own]} | place
        made.append({"law": "coulomb"} | form)
        if stribeck:
            made.append({"law": "stribeck", "speed": list(SPEED)[own]} | form)
    return [*made, {"law": "spring", "joints": ["joint_2"]}]


def laws(rotors: bool, stribeck: bool) -> str:
    """The same as a table of the robot file."""
    return tomlkit.dumps({"model": {"terms": terms(rotors, stribeck)}})


def limits(share: float = 1.0) -> str:
    """Table 2."""
    rows = [
        f"joint_{k} = {{ lower = {-share * q:.4f}, upper = {share * q:.4f}, "
        f"velocity = {share * dq:.4f} }}"
        for k, (q, dq, _) in enumerate(LIMITS, start=1)
    ]
    return "[robot.limits]\n" + "\n".join(rows) + "\n"


def known(robot: Path = ROBOTS / "p3_rx160.toml", boxes: Sequence[float] = BOXES) -> str:
    """Bounds of the convex programs, sect. 3.1.

    Args:
        robot: Robot file with nominal bodies.
        boxes: Half edge of each link's box [m].
    """
    bodies = steelyard.load_robot(robot).robot.bodies
    bounds = []
    for body, edge in zip(bodies, boxes, strict=True):
        low, high = ([round(x + s * edge, 3) for x in body.inertia.com.tolist()] for s in (-1, 1))
        bounds.append(
            f'[[knowledge]]\nkind = "mass"\nlink = "{body.name}"\n'
            f"lower = {LIGHT * body.inertia.mass:g}\nupper = {HEAVY * body.inertia.mass:g}\n"
            f'[[knowledge]]\nkind = "centre_in_box"\nlink = "{body.name}"\n'
            f"lower = {low}\nupper = {high}\n"
        )
    return "".join(bounds)


DESIGN = f"""
[excitation]
samples = 1000
[excitation.motion]
kind = "fourier"
period = 10.0
harmonics = 6
[excitation.limits]
share = 1.0
position_margin = 0.0
effort = "any"
acceleration = {[ddq for _, _, ddq in LIMITS]}
[excitation.workspace]
{BOX}
[excitation.criterion]
kind = "condition"
"""
"""Sect. 5.1: six harmonics of 0.1 Hz."""

UNKNOWN = '[prior]\nsource = "none"\n'
PRINTED = """
[processing]
motion = "kalman_filter"
effort = "kalman_filter"
matched_cutoff = "off"
rest_speed = "off"
[estimation]
weights = "equal"
effort_scales = "off"
"""
LEAST_SQUARES = 'method = "OLS"\n'
"""Masses of the robot file are not used; eqs. 13 and 14 with all samples of all joints, behind a
Kalman filter; without constraints."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Torque errors of one model along one motion.

    Attributes:
        mean: Mean of the absolute error of each joint [Nm], shape `(6,)`.
        deviation: Its standard deviation, likewise.
    """

    mean: Array
    deviation: Array


@dataclass(frozen=True, eq=False)
class Signals:
    """A log behind the same smoothing for all methods, so that parameters alone differ.

    Attributes:
        motion: Times, positions, velocities and accelerations.
        effort: Torques, shape `(N, 6)` [Nm].
    """

    motion: steelyard.Motion
    effort: Array

    def rows(self) -> Array:
        """Time, positions, velocities and accelerations, shape `(19, N)`."""
        own = self.motion
        return np.vstack([own.t, own.q.T, own.dq.T, own.ddq.T])


@dataclass(frozen=True, eq=False)
class Wrenches:
    """The wrench at the tool along one log, axes of the base, by `ESTIMATES`.

    Attributes:
        t: Shape `(N,)` [s].
        measured: By a force/torque sensor, less its bias, shape `(N, 6)` [N; Nm].
        found: By estimate, likewise.
        errors: Mean, standard deviation and relative errors by component, by estimate: keys of
            `wrench.json`.
        regular: Whether the posture is not near-singular, shape `(N,)`.
    """

    t: Array
    measured: Array
    found: dict[str, Array]
    errors: dict[str, tuple[dict[str, float], ...]]
    regular: NDArray[np.bool_]

    def force(self, name: str, regular: bool = False) -> float:
        """Root mean square error of the force, all components; of regular postures only [N]."""
        every = self.found[name] - self.measured
        return float(np.sqrt(np.mean((every[self.regular] if regular else every)[:, :3] ** 2)))


@dataclass(frozen=True, eq=False)
class Found:
    """What one seed gave.

    Attributes:
        condition: Condition number of the designed motion, without the Stribeck columns.
        certified: Whether it is proven to keep all limits.
        sizes: As `sizes` has them.
        errors: By method, motion of the identification, and `fit` or `test`.
        least: Least eigenvalue of the pseudo-inertias of all bodies by method and motion.
        indefinite: Share of the test motion on which the mass matrix is indefinite, likewise.
        values: Standard parameters after the designed motion: of the paper's program, ours, true;
            of least squares those that are base parameters.
        wrenches: Of the pushes and of the load.
        events: Times [s] and masses [kg] of what was picked up and put down.
        pick: When the load was really picked up and released [s].
        motions: Rows of the designed, the poor and the test motion.
        torques: Time, measured and predicted torques by method: of the designed motion, of the
            test motion after it and after the poor one.
    """

    condition: float
    certified: bool
    sizes: tuple[int, int, int, int]
    errors: dict[tuple[str, str, str], Errors]
    least: dict[tuple[str, str], float]
    indefinite: dict[tuple[str, str], float]
    values: dict[str, dict[str, float]]
    wrenches: dict[str, Wrenches]
    events: tuple[tuple[float, float], ...]
    pick: tuple[float, float]
    motions: tuple[Array, ...]
    torques: dict[tuple[str, str], tuple[Array, Array, dict[str, Array]]]


def one(folder: Path, seed: int, quick: bool) -> Found:
    """Design, run, identify by all methods, predict a test motion, estimate wrenches."""
    rng = np.random.default_rng(seed)
    files = robot_files(folder)
    arm = files["arm"]
    steelyard.simulate(files["drawn"], folder / "drawn", period=0.5, seed=seed)
    truth = drawn_truth(folder / "drawn" / "truth.json", folder / "truth.json", rng)
    designed = steelyard.design_excitation(
        files["design"], budget=300.0, searches=2 if quick else 8, processes=1, seed=seed
    )
    motion = designed.save(folder / "motion") / "trajectory.json"
    steelyard.simulate(arm, folder / "designed", motion, truth=truth, seed=seed)
    steelyard.simulate(files["small"], folder / "poor", period=10.0, truth=truth, seed=seed)
    steelyard.simulate(arm, folder / "test", period=10.0, truth=truth, seed=1000 + seed)
    logs = {name: str(folder / name / "log.csv") for name in (*MOTIONS, "test")}
    models = {
        (method, log): steelyard.identify(files[method], logs[log], check=False, threads=1).model
        for method in METHODS
        for log in MOTIONS
    }
    signals = {name: samples(files["ours"], log) for name, log in logs.items()}
    test = signals["test"]
    best = {name: models[name, "designed"] for name in USED}
    values = {name: standard_values(model) for name, model in best.items()}
    values["truth"] = true_values(truth)
    values["OLS"] = models["OLS", "designed"].estimate.parameters.as_dict()
    pick = (5.0, 15.0, 20.0) if quick else (13.0, 54.0, 66.0)
    pushed = pushed_log(arm, folder, truth, 10.0 if quick else 20.0, seed)
    carried = loaded_log(arm, folder, truth, pick, seed)
    with_sensor(best["ours"], files["ours"], carried, pick, rng)
    found = designed.to_dict()
    return Found(
        found["condition"],
        found["certified"],
        sizes(files["convex"], files["ours"]),
        {
            (method, motion, kind): errors(model, signals[log])
            for (method, motion), model in models.items()
            for kind, log in (("fit", motion), ("test", "test"))
        },
        {key: least_eigenvalue(standard_values(models[key])) for key in models if key[0] in USED},
        {key: indefinite(model, test.motion.q) for key, model in models.items()},
        values,
        {"pushes": wrenches(best, pushed), "load": wrenches(best, carried)},
        tuple(
            (event.time, event.mass)
            for event in steelyard.payload_events(best["ours"], carried).events
        ),
        pick[:2],
        tuple(signals[name].rows() for name in (*MOTIONS, "test")),
        {
            (motion, kind): (
                signals[log].motion.t,
                signals[log].effort,
                {m: models[m, motion].torque(signals[log].motion) for m in METHODS},
            )
            for motion, kind, log in (
                ("designed", "fit", "designed"),
                ("designed", "test", "test"),
                ("poor", "test", "test"),
            )
        },
    )


def robot_files(folder: Path) -> dict[str, Path]:
    """The arm, bodies and rotors alone, small ranges, the design, and one file of each method."""
    ours, paper = laws(rotors=True, stribeck=False), laws(rotors=False, stribeck=True)
    tables = {
        "drawn": '[model]\nterms = ["rigid_body", "rotor_inertia"]\n',
        "arm": limits() + laws(rotors=True, stribeck=True),
        "small": limits(POOR) + laws(rotors=True, stribeck=True),
        "design": limits() + ours + DESIGN,
        "ours": limits() + ours + UNKNOWN + known(),
        "OLS": limits() + paper + UNKNOWN + PRINTED + LEAST_SQUARES,
        "convex": limits() + paper + UNKNOWN + PRINTED + known(),
    }
    return {name: robot_file("p3_rx160", folder / f"{name}.toml", t) for name, t in tables.items()}


def drawn_truth(drawn: Path, target: Path, rng: np.random.Generator) -> Path:
    """Write a true arm: bodies and rotors as drawn, friction of table 4, every value by seed."""
    truth = json.loads(drawn.read_text(encoding="utf-8"))
    sizes = {"spring.joint_2": SPRING}
    for place, coulomb, viscous in zip(PLACES, COULOMB, VISCOUS, strict=True):
        sizes |= {f"coulomb.{place}": coulomb, f"viscous.{place}": viscous}
        sizes[f"stribeck.{place}"] = STICTION * coulomb
    truth["terms"] = terms(rotors=True, stribeck=True)
    truth["parameters"] |= {
        name: {"value": size * rng.uniform(1.0 - SPREAD, 1.0 + SPREAD), "unit": ""}
        for name, size in sizes.items()
    }
    target.write_text(json.dumps(truth, indent=1), encoding="utf-8")
    return target


def true_values(truth: Path) -> dict[str, float]:
    """Standard parameters of the true arm."""
    parameters = json.loads(truth.read_text(encoding="utf-8"))["parameters"]
    return {name: one["value"] for name, one in parameters.items()}


def standard_values(model: steelyard.IdentifiedModel) -> dict[str, float]:
    """Standard parameters of a consistent estimate."""
    standard = model.estimate.standard
    assert standard is not None  # of every consistent estimate
    return standard.parameters.as_dict()


def sizes(paper: Path, ours: Path) -> tuple[int, int, int, int]:
    """Base and standard parameters of the paper's model, and of ours."""
    model, own = steelyard.model_of(paper), steelyard.model_of(ours)
    return (
        len(steelyard.base_parameters(model)),
        len(model.names),
        len(steelyard.base_parameters(own)),
        len(own.names),
    )


def samples(robot: Path, log: str) -> Signals:
    """A log's signals."""
    (read,) = steelyard.load_runs(robot, log)
    data = read.whole()
    return Signals(data.motion, data.effort)


def errors(model: steelyard.IdentifiedModel, data: Signals) -> Errors:
    """As tables 5 and 6 have them."""
    size = np.abs(data.effort - model.torque(data.motion))
    return Errors(size.mean(axis=0), size.std(axis=0))


def least_eigenvalue(values: dict[str, float]) -> float:
    """Least eigenvalue of the pseudo-inertias of all links; a consistent body has none below 0."""
    names = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
    return min(least_of_body(*(values[f"{name}.link_{k}"] for name in names)) for k in range(1, 7))


def least_of_body(m: float, mx: float, my: float, mz: float, *inertia: float) -> float:
    """Least eigenvalue of a pseudo-inertia.

    Args:
        m: Mass [kg].
        mx: First moment [kg m].
        my: Likewise.
        mz: Likewise.
        inertia: xx, xy, xz, yy, yz, zz about the frame's origin [kg m²].
    """
    tensor = np.zeros((3, 3))
    tensor[np.triu_indices(3)] = inertia
    tensor += np.triu(tensor, 1).T
    second = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    moment = np.array([[mx, my, mz]])
    return float(np.linalg.eigvalsh(np.block([[second, moment.T], [moment, np.array([[m]])]]))[0])


def indefinite(model: steelyard.IdentifiedModel, q: Array) -> float:
    """Share of postures at which the mass matrix is indefinite, as of inconsistent bodies."""
    return float(np.mean(np.linalg.eigvalsh(model.mass_matrix(q[::10]))[:, 0] <= 0.0))


def pushed_log(arm: Path, folder: Path, truth: Path, period: float, seed: int) -> str:
    """A log of a random motion with pushes on the last link, along random directions."""
    rng = np.random.default_rng(2000 + seed)
    t = np.arange(0.0, period + 2.0, 0.01)
    wrench = np.zeros((len(t), 6))
    for start in np.arange(2.0, t[-1] - LASTS - 1.0, EVERY):
        phase = np.minimum(t - start, start + LASTS - t) / RAMP
        size = 0.5 - 0.5 * np.cos(np.pi * np.clip(phase, 0.0, 1.0))
        force, point = rng.standard_normal((2, 3))
        force *= PUSH / np.linalg.norm(force)
        moment = np.cross(LEVER * point / np.linalg.norm(point), force)
        wrench += size[:, None] * np.concatenate([force, moment])
    table, rows = folder / "pushes.csv", np.column_stack([t, wrench])
    np.savetxt(table, rows, "%.9g", ",", header=f"time_s,{SENSOR}", comments="")
    steelyard.simulate(
        arm, folder / "pushed", period=period, truth=truth, wrench=table, seed=2000 + seed
    )
    return str(folder / "pushed" / "log.csv")


def loaded_log(
    arm: Path, folder: Path, truth: Path, pick: tuple[float, float, float], seed: int
) -> str:
    """A log of a random motion on which a load is picked up and released."""
    steelyard.simulate(
        arm,
        folder / "loaded",
        period=pick[2],
        truth=truth,
        payload_mass=LOAD,
        attach=pick[0],
        release=pick[1],
        seed=3000 + seed,
    )
    return str(folder / "loaded" / "log.csv")


def with_sensor(
    model: steelyard.IdentifiedModel,
    robot: Path,
    log: str,
    pick: tuple[float, float, float],
    rng: np.random.Generator,
) -> None:
    """Add columns of a force/torque sensor between tool and load to a log, with bias and noise.

    The load is a steel ball about the tool's origin; the moment of its rotation is less than
    0.01 Nm.
    """
    motion = samples(robot, log).motion
    speed = np.einsum("nij,nj->ni", model.jacobian(motion.q, TOOL), motion.dq)
    force = LOAD * (GRAVITY - np.gradient(speed[:, :3], motion.t, axis=0))
    force *= ((motion.t >= pick[0]) & (motion.t < pick[1]))[:, None]
    force = np.einsum("nij,ni->nj", model.pose(motion.q, TOOL)[1], force)
    head = Path(log).read_text(encoding="utf-8").partition("\n")[0]
    rows = np.loadtxt(log, delimiter=",", skiprows=1)
    t = rows[:, 0] - rows[0, 0]
    read = BIAS + SENSOR_NOISE * rng.standard_normal((len(t), 6))
    read[:, :3] += np.column_stack([np.interp(t, motion.t, x, 0.0, 0.0) for x in force.T])
    table = np.column_stack([rows, read])
    np.savetxt(log, table, "%.9g", ",", header=f"{head},{SENSOR}", comments="")


def wrenches(models: dict[str, steelyard.IdentifiedModel], log: str) -> Wrenches:
    """By our smoother, and by the paper's eq. 8 with its model and with ours, beside the sensor."""
    ours = steelyard.external_wrench(models["ours"], log, TOOL, axes="base", measured="auto")
    assert ours.measured is not None  # as its columns are named
    convex, inverse = (
        steelyard.external_wrench(
            models[name],
            log,
            TOOL,
            residual="torque",
            method="inverse",
            bandwidth=ours.estimate.bandwidth,
            axes="base",
            measured="auto",
        )
        for name in USED
    )
    found = dict(zip(ESTIMATES, (convex, inverse, ours), strict=True))
    return Wrenches(
        ours.t,
        ours.measured.wrench,
        {name: one.wrench for name, one in found.items()},
        {name: tuple(one.to_dict()["measured"]["components"]) for name, one in found.items()},
        convex.estimate.condition <= SINGULAR,
    )


def stribeck_share() -> float:
    """Largest value of a Stribeck column with table 4's constants, that of Coulomb's being 1."""
    speed = np.logspace(-4.0, 0.0, 2000)
    return max(
        float(np.max(2.0 / np.pi * np.arctan(c * speed) * np.exp(-speed / width)))
        for c, width in zip(STEEP, SPEED, strict=True)
    )


def printed_least() -> tuple[tuple[float, ...], ...]:
    """Least eigenvalues of the printed bodies, for each reading of `READINGS`."""
    return tuple(
        tuple(
            least_of_body(
                own[0],
                *(x * (own[0] if centre else 1.0) for x in own[1:4]),
                *(own[4 + k] for k in order),
            )
            for own in PRINTED_BODIES
        )
        for _, order, centre in READINGS
    )


def means(found: Sequence[Found], method: str, motion: str, kind: str) -> list[float]:
    """Mean over joints of the mean absolute error, by seed [Nm]."""
    return [float(one.errors[method, motion, kind].mean.mean()) for one in found]


def ratios(one: Sequence[float], other: Sequence[float]) -> list[float]:
    """Element by element."""
    return [a / b for a, b in zip(one, other, strict=True)]


def order_of(found: Sequence[Found], motion: str) -> list[float]:
    """Test error of least squares over that of the convex program, both as printed, by seed."""
    return ratios(means(found, "OLS", motion, "test"), means(found, "convex", motion, "test"))


def verdicts(found: Sequence[Found]) -> Table:
    """What the paper claims, and whether it holds here."""
    seeds = len(found)
    fit = ratios(means(found, "OLS", "designed", "fit"), means(found, "convex", "designed", "fit"))
    rises = {
        (m, motion): ratios(means(found, m, motion, "test"), means(found, m, motion, "fit"))
        for m in ("OLS", "convex")
        for motion in MOTIONS
    }
    order = {motion: order_of(found, motion) for motion in MOTIONS}
    better = {motion: sum(x > 1.0 for x in order[motion]) for motion in MOTIONS}
    doubled = bool(np.median(rises["OLS", "designed"]) >= 1.7)
    stays = bool(np.median(rises["convex", "designed"]) <= 1.3)
    invalid = sum(max(one.indefinite["OLS", m] for m in MOTIONS) > 0.0 for one in found)
    printed = max(sum(x > 0.0 for x in own) for own in printed_least())
    forces = {
        name: [one.wrenches["pushes"].force(name, True) for one in found] for name in ESTIMATES
    }
    eq17 = [
        float(np.mean([own["relative_absolute"] for own in one.wrenches["pushes"].errors["ours"]]))
        for one in found
    ]
    accurate = {name: bool(np.median(own) <= 0.2 * PUSH) for name, own in forces.items()}

    def holds(*true: bool) -> str:
        return "yes" if all(true) else "partly" if any(true) else "no"

    rows = (
        (
            "both methods predict the identification motion equally well (table 5: 6.644 and "
            "6.154 Nm)",
            holds(max(abs(x - 1.0) for x in fit) <= 0.1),
            f"error of least squares over that of the convex program {over_seeds(fit)}",
        ),
        (
            "on test motions the convex program is largely better than least squares (table 6)",
            holds(*(better[m] == seeds and bool(np.median(order[m]) > 1.2) for m in MOTIONS)),
            f"error of least squares over that of the convex program: after the designed motion "
            f"{over_seeds(order['designed'])}, above 1 in {better['designed']} of {seeds} seeds; "
            f"after the poor one {over_seeds(order['poor'])}, above 1 in {better['poor']}",
        ),
        (
            "on test motions the error of least squares almost doubles, that of the convex program "
            "stays",
            holds(doubled, stays),
            "error on the test motion over that on the designed one: least squares "
            f"{over_seeds(rises['OLS', 'designed'])}, convex "
            f"{over_seeds(rises['convex', 'designed'])}; over that on the poor one: "
            f"{over_seeds(rises['OLS', 'poor'])} and {over_seeds(rises['convex', 'poor'])}",
        ),
        (
            "the convex program's bodies are consistent, those of least squares are not",
            holds(printed == 6, invalid == seeds),
            f"of the printed bodies {printed} of 6 are possible, in the best reading; here all "
            "are, by the constraints; least squares has an indefinite mass matrix in "
            f"{invalid} of {seeds} seeds",
        ),
        (
            "the identified model estimates external forces accurately (table 7, not legible)",
            holds(accurate[ESTIMATES[0]], accurate[ESTIMATES[2]]),
            f"pushes of {PUSH:g} N, RMS error of the force in regular postures: "
            + "; ".join(f"{name} {over_seeds(own, 'N')}" for name, own in forces.items())
            + f"; eq. 17 of ours, all postures, mean of six components {over_seeds(eq17)}",
        ),
    )
    columns = ("the paper", "holds here", "figure")
    return Table("What the paper claims, and whether it holds here", rows, columns)


def page(found: Sequence[Found]) -> Page:
    """Tables, pictures and bounds."""
    first = found[0]
    order = {motion: order_of(found, motion) for motion in MOTIONS}
    ours = ratios(
        means(found, "ours", "designed", "test"), means(found, "convex", "designed", "test")
    )
    forces = [
        max(w.force(ESTIMATES[2], True) / w.force(ESTIMATES[1], True) for w in f.wrenches.values())
        for f in found
    ]
    largest = [max(w.force(ESTIMATES[2]) for w in one.wrenches.values()) for one in found]
    claims = (
        Claim("test error after the designed motion, least squares over convex, median",
              over_seeds(order["designed"]), ">= 1", bool(np.median(order["designed"]) >= 1.0)),
        Claim("test error after the poor motion, least squares over convex, every seed",
              over_seeds(order["poor"]), ">= 1.2", min(order["poor"]) >= 1.2),
        Claim("test error after the designed motion, ours over the paper's method, median",
              over_seeds(ours), "< 1", bool(np.median(ours) < 1.0)),
        Claim("limits of the designed motion proven",
              f"{sum(one.certified for one in found)} of {len(found)} seeds", "all",
              all(one.certified for one in found)),
        Claim("force at the tool, RMS over that of eq. 8 with our model, regular postures",
              over_seeds(forces), "< 1", max(forces) < 1.0),
        Claim("force at the tool, RMS, pushes or load (the larger), near-singular postures as "
              "well, every seed",
              over_seeds(largest, "N"), f"<= {0.2 * PUSH:g} N", max(largest) <= 0.2 * PUSH),
        Claim("load found within 0.5 s and 10 %, nothing else found",
              f"{sum(load_found(one) for one in found)} of {len(found)} seeds", "all",
              all(load_found(one) for one in found)),
        Claim("printed consistent bodies that are possible, best reading",
              f"{max(sum(x > 0.0 for x in own) for own in printed_least())} of 6",
              "< 6", all(min(own) < 0.0 for own in printed_least())),
    )  # fmt: skip
    parts: tuple[Part, ...] = (
        verdicts(found),
        STORY,
        motion_table(found),
        motion_picture(first),
        Text("Torque errors", ERRORS),
        *(error_table(found, motion, kind) for motion in MOTIONS for kind in ("fit", "test")),
        error_picture(found),
        *(torque_picture(first, *which) for which in TORQUES),
        Text("Parameters", PARAMETERS),
        parameter_table(first),
        friction_table(found),
        body_table(found),
        printed_table(),
        Text("Wrench at the tool", WRENCHES),
        *(wrench_table(found, name) for name in WRENCH_NAMES),
        event_table(found),
        *(wrench_picture(first, name) for name in WRENCH_NAMES),
    )
    return Page(
        "Consistent identification of six joints, and the wrench at the tool", parts, claims
    )


STORY = Text(
    "",
    (
        "A Stäubli RX-160 is identified from one Fourier motion by a convex program with "
        "physically consistent bodies, beside ordinary least squares. Here a simulated arm of its "
        "geometry takes its place. For every seed it has other masses, inertias, rotors and "
        "friction; no estimator sees them.",
        "Assumed, as the paper does not print it: lengths (0.15, 0.825, 0.625 and 0.11 m, base "
        "0.55 m), masses, rotor inertias, bounds of masses (0.3 to 3 times those of the robot "
        "file) and centres of mass (boxes of 0.2 or 0.6 m), a box of the flange (table 3 is not "
        "legible), noise of 1 % of a joint's typical torque. Friction is the convex column of "
        f"table 4, every value changed by up to 20 %, static friction 20 % above Coulomb's, and "
        f"a spring of {SPRING:g} Nm/rad, for which table 4 has 0.012.",
        "Misprinted: eq. 6 multiplies eq. 5, which contains the sign, by the arctan, so that "
        "friction would never change its sign; here the arctan replaces it. The model has 58 base "
        "parameters (36 of the bodies, 21 of friction, the spring), 57 are printed and none is "
        "listed. Masses of 1e11 kg (table 4, OLS) come from standard parameters, of which the "
        "data determine combinations alone; least squares here has base parameters. Eq. 16 has N "
        "outside of the root; tables 5 and 6 are means of absolute errors. Static friction is "
        "printed below Coulomb friction. Text and captions exchange figs. 9 and 10. No body of "
        "table 4's convex column but two is physically consistent in any reading of its "
        "symbols.",
        "Different from the paper: the simulated arm has rotor inertias, as geared drives have. "
        "The paper's model leaves them out, in both of its methods; ours identifies them. "
        "With the constants of table 4 a Stribeck column is at most 1.4 % of "
        "Coulomb's, so that no motion shows its parameter (the paper's OLS has 9799 Nm): ours "
        "leaves it out.",
    ),
)

ERRORS = (
    "Mean of the absolute error (tables 5 and 6) behind the same smoothing for all, so that only "
    "parameters differ. Least squares and the paper's method have the paper's model and signals: "
    "motion and torques behind a Kalman filter, all samples of all joints with equal weights, no "
    "filter of the regressor, rests included. Only the constraints differ: bounds of masses, "
    "centres and friction, physically consistent bodies. Both filters are causal, so late. Ours "
    "(the defaults): our model, signals smoothed as the data require, joints weighted by their "
    "residuals, the same bounds. The poor motion has a tenth of the ranges and speeds of table 2. "
    "The test motion is a random one within the limits, as fig. 7 is.",
)

PARAMETERS = (
    "Friction, spring and bodies, from the designed motion. Masses are bounded by what is known "
    "in advance, as torques determine combinations of them alone: values at a bound are no "
    "estimates, and least squares has none. l is the centre of mass [m] here.",
)

WRENCHES = (
    f"Pushes of {PUSH:g} N for {LASTS:g} s every {EVERY:g} s on a random motion, {LEVER:g} m from "
    f"the tool's origin; and a load of {LOAD:g} kg that is picked up at 13 s and released at 54 s "
    "(5 and 15 s in the quick form). "
    "The paper inverts the transposed Jacobian (eq. 8) at every sample, with errors without bound "
    "in near-singular postures (condition number above 100). Ours is a smoother over time, with "
    "the uncertainty of the model and of friction. All have the same low-pass. They are compared "
    "with a force/torque sensor of the log by steelyard wrench --measured: with noise of 0.2 N and "
    "0.01 Nm, and in the log with the load with a bias, estimated at rest at the start. The "
    "relative absolute error is that of eq. 17; beside it the sum of absolute errors over that of "
    "the measured values. The load's horizontal forces and its moments about the tool's origin are "
    "near zero, and so is what these errors divide by.",
)

QUANTITIES = {
    "mean": "mean error",
    "std": "deviation",
    "relative_absolute": "relative absolute error (eq. 17)",
    "relative": "relative error",
}
WRENCH_NAMES = {"pushes": "Pushes (table 7, figs. 9 and 10)", "load": "Load of 2 kg (likewise)"}
HEADINGS = ("the paper's least squares here", "the paper's method here", "ours")
TORQUES = (
    ("designed", "fit", "fig. 6"),
    ("designed", "test", "fig. 8"),
    ("poor", "test", "fig. 8, poor motion"),
)
READINGS = (
    ("order xx xy xz yy yz zz, l the first moment", (0, 1, 2, 3, 4, 5), False),
    ("order xx xy xz yy yz zz, l the centre", (0, 1, 2, 3, 4, 5), True),
    ("order as labelled, l the first moment", (0, 3, 4, 1, 5, 2), False),
    ("order as labelled, l the centre", (0, 3, 4, 1, 5, 2), True),
)
"""What l and the six inertias of table 4 may mean; places of xx, xy, xz, yy, yz, zz."""


def load_found(one: Found) -> bool:
    """Whether the load was found when it was picked up and released, and nothing else."""
    return len(one.events) == 2 and all(
        abs(time - when) <= 0.5 and abs(mass / LOAD - 1.0) <= 0.1
        for (time, mass), when in zip(one.events, one.pick, strict=True)
    )


def motion_table(found: Sequence[Found]) -> Table:
    """The designed motion and the model's size."""
    first = found[0]
    designed = first.motions[0]
    speed = np.abs(designed[7:13]).max(axis=1) / [dq for _, dq, _ in LIMITS]
    push = np.abs(designed[13:19]).max(axis=1) / [ddq for _, _, ddq in LIMITS]
    return Table(
        "Excitation and model",
        (
            ("condition number of the designed motion", "not printed", "–",
             over_seeds([one.condition for one in found])),
            ("limits of table 2 and the box", "kept", "–",
             f"proven, {sum(one.certified for one in found)} of {len(found)} seeds"),
            ("largest speed over its limit, first seed", "fig. 5", "–", f"{speed.max():.2f}"),
            ("largest acceleration over its limit", "fig. 5", "–", f"{push.max():.2f}"),
            ("base parameters (ours: with rotors, without Stribeck friction)", "57",
             f"{first.sizes[0]}", f"{first.sizes[2]}"),
            ("standard parameters (96 with the constants of each friction curve)", "96",
             f"{first.sizes[1]}", f"{first.sizes[3]}"),
            ("largest Stribeck column, Coulomb's being 1", "not examined",
             f"{stribeck_share():.3f}", "left out"),
        ),
    )  # fmt: skip


def error_table(found: Sequence[Found], motion: str, kind: str) -> Table:
    """Tables 5 and 6."""
    printed = motion == "designed" and kind == "fit"
    rows = []
    for k, joint in enumerate(JOINTS):
        own = [PAPER_ERRORS[m][k] for m in ("OLS", "convex")]
        cells = [f"{x:.3g}" if printed else "–" for x in own]
        rows.append((joint, *cells, *(
            over_seeds([f.errors[m, motion, kind].mean[k] for f in found]) for m in METHODS
        )))  # fmt: skip
    own = [PAPER_ERRORS[m][6] for m in ("OLS", "convex")]
    cells = [f"{x:.3g}" if printed else "–" for x in own]
    if motion == "designed" and kind == "test":
        cells = ["about doubled", "as before"]
    rows.append(("mean", *cells, *(over_seeds(means(found, m, motion, kind)) for m in METHODS)))
    deviations = [
        f"{np.mean(PAPER_DEVIATIONS[m]):.3g}" if printed else "–" for m in ("OLS", "convex")
    ]
    rows.append(("standard deviation, mean", *deviations, *(
        over_seeds([float(f.errors[m, motion, kind].deviation.mean()) for f in found])
        for m in METHODS
    )))  # fmt: skip
    where = {
        "fit": f"the {motion} motion itself",
        "test": f"the test motion, from the {motion} one",
    }
    source = {"fit": " (table 5)", "test": " (table 6)"}[kind] if motion == "designed" else ""
    columns = ("", "paper, OLS", "paper, convex", *HEADINGS)
    return Table(f"Error on {where[kind]}{source} [Nm]", tuple(rows), columns)


def parameter_table(first: Found) -> Table:
    """Table 4, all bodies, spring and friction."""

    def cells(name: str, factor: str = "") -> tuple[str, ...]:
        """The paper's program, ours, truth; over the value of a factor, if any."""
        return tuple(
            f"{own[name] / (own[factor] if factor else 1.0):.4g}" if name in own else "–"
            for own in (first.values[m] for m in (*USED, "truth"))
        )

    def free(name: str) -> str:
        """Least squares."""
        own = first.values["OLS"]
        return f"{own[name]:.4g}" if name in own else "–"

    rows = [
        (f"{label}, link {k}", f"{PRINTED_BODIES[k - 1][row]:.4g}", "see the text", "–",
         *cells(f"{name}.link_{k}", f"m.link_{k}" if label.startswith("l") else ""))
        for k in range(1, 7)
        for row, (label, name) in enumerate(zip(BODY, NUMBERS, strict=True))
    ]  # fmt: skip
    spring = "spring.joint_2"
    rows.append(("k, joint 2 [Nm/rad]", "0.012", "-11890", free(spring), *cells(spring)))
    rows += [
        (f"{label}, {joint}", f"{PAPER_FRICTION['convex'][law][k]:g}",
         f"{PAPER_FRICTION['OLS'][law][k]:g}", free(name), *cells(name))
        for k, (joint, place) in enumerate(zip((*JOINTS, "q5 + q6"), PLACES, strict=True))
        for law, (kind, label) in enumerate(LAWS.items())
        for name in (f"{kind}.{place}",)
    ]  # fmt: skip
    columns = ("", "paper, convex", "paper, OLS", *HEADINGS, "truth")
    title = "Bodies about the links' origins, spring and friction (table 4), first seed"
    return Table(title, tuple(rows), columns)


def friction_table(found: Sequence[Found]) -> Table:
    """Friction and spring of all seeds: values over the true ones."""

    def over_truth(name: str, method: str) -> str:
        return over_seeds([f.values[method][name] / f.values["truth"][name] for f in found])

    rows = [
        (f"{label}, {joint}", *(over_truth(f"{law}.{place}", m) for m in USED))
        for joint, place in zip((*JOINTS, "q5 + q6"), PLACES, strict=True)
        for law, label in LAWS.items()
        if law != "stribeck"
    ]
    rows.append(("spring", *(over_truth("spring.joint_2", m) for m in USED)))
    columns = ("", "the paper's method here", "ours")
    return Table("Friction and spring over the true values", tuple(rows), columns)


def body_table(found: Sequence[Found]) -> Table:
    """Whether bodies are possible."""
    rows = []
    for motion in MOTIONS:
        least = (over_seeds([f.least[m, motion] for f in found], digits=2) for m in USED)
        rows.append((f"least eigenvalue of the pseudo-inertias, {motion} motion", "–", *least))
        shares = (
            over_seeds([100.0 * f.indefinite[m, motion] for f in found], "%") for m in METHODS
        )
        rows.append(
            (
                f"postures of the test motion with an indefinite mass matrix, {motion} motion",
                *shares,
            )
        )
    return Table("Bodies that are possible", tuple(rows), ("", *HEADINGS))


def printed_table() -> Table:
    """Printed bodies."""
    rows = tuple(
        (name, *(f"{x:.3g}" for x in own), f"{sum(x > 0.0 for x in own)}")
        for (name, *_), own in zip(READINGS, printed_least(), strict=True)
    )
    columns = (
        "least eigenvalue of the pseudo-inertia",
        *(f"link {k}" for k in range(1, 7)),
        "possible",
    )
    return Table("The convex column of table 4: bodies in four readings", rows, columns)


def wrench_table(found: Sequence[Found], name: str) -> Table:
    """Table 7."""
    logs = [one.wrenches[name] for one in found]
    rows = []
    for k, component in enumerate(COMPONENTS):
        for key, what in QUANTITIES.items():
            rows.append((f"{component}, {what}", "not legible", *(
                over_seeds([w.errors[m][k][key] for w in logs]) for m in ESTIMATES
            )))  # fmt: skip
    for words, regular in (("", False), (", regular postures", True)):
        rows.append((f"force, RMS [N]{words}", "–", *(
            over_seeds([w.force(m, regular) for w in logs]) for m in ESTIMATES
        )))  # fmt: skip
    columns = ("", "paper", *ESTIMATES)
    return Table(WRENCH_NAMES[name], tuple(rows), columns)


def event_table(found: Sequence[Found]) -> Table:
    """Times and mass of the load."""
    rows = []
    for k, what in enumerate(("picked up", "released")):
        known = [one for one in found if len(one.events) == 2]
        late = [one.events[k][0] - one.pick[k] for one in known]
        mass = [one.events[k][1] for one in known]
        rows.append(
            (f"{what}, time found minus true [s]", "not examined", "–", over_seeds(late, digits=2))
        )
        rows.append((f"{what}, mass [kg] (true: {LOAD:g})", "not examined", "–", over_seeds(mass)))
    return Table("Load, when and how heavy", tuple(rows))


def motion_picture(first: Found) -> Picture:
    """Figs. 5 and 7."""
    panels = tuple(
        Panel(f"{name}: {what}", "time [s]", unit,
              tuple(Curve("", rows[0], own) for own in rows[k : k + 6]))
        for what, unit, k in (
            ("positions", "rad", 1),
            ("velocities", "rad/s", 7),
            ("accelerations", "rad/s²", 13),
        )
        for name, rows in (("designed", first.motions[0]), ("test", first.motions[2]))
    )  # fmt: skip
    caption = (
        "The designed motion (fig. 5) and the test motion (fig. 7) of the first seed, six joints."
    )
    return Picture("motions", caption, panels)


def error_picture(found: Sequence[Found]) -> Picture:
    """Test errors, a dot per seed."""
    panels = []
    for motion in MOTIONS:
        x = np.repeat(np.arange(7), len(found)).astype(float)
        curves = tuple(
            Curve(name, x + 0.2 * (k - 1),
                  np.array([[*f.errors[m, motion, "test"].mean,
                             f.errors[m, motion, "test"].mean.mean()] for f in found]).T.ravel(),
                  points=True, colour=(4, 1, 0)[k])
            for k, (m, name) in enumerate(zip(METHODS, ("OLS", "paper", "ours"), strict=True))
        )  # fmt: skip
        ticks = (*(str(k) for k in range(1, 7)), "mean")
        panels.append(Panel(f"after the {motion} motion", "joint", "mean error [Nm]", curves,
                            log=True, ticks=ticks))  # fmt: skip
    caption = "Errors on the test motion, one dot per seed; the scale is logarithmic."
    return Picture("errors", caption, tuple(panels))


def torque_picture(first: Found, motion: str, kind: str, figure: str) -> Picture:
    """Figs. 6 and 8."""
    t, measured, predicted = first.torques[motion, kind]
    drawn = (("measured", measured, 4), ("OLS", predicted["OLS"], 1),
             ("convex", predicted["convex"], 2), ("ours", predicted["ours"], 0))  # fmt: skip
    panels = tuple(
        Panel(joint, "time [s]", "Nm",
              tuple(Curve(name, t, torque[:, k], colour=colour) for name, torque, colour in drawn))
        for k, joint in enumerate(JOINTS)
    )  # fmt: skip
    what = "designed motion itself" if kind == "fit" else f"test motion, from the {motion} one"
    caption = (
        f"Torques of the {what}, first seed ({figure}): measured, and predicted by the paper's two "
        "methods and by ours."
    )
    return Picture(f"torques-{motion}-{kind}", caption, panels)


def wrench_picture(first: Found, name: str) -> Picture:
    """Figs. 9 and 10, all components."""
    own, panels = first.wrenches[name], []
    for k, component in enumerate(COMPONENTS):
        half = slice(0, 3) if k < 3 else slice(3, 6)
        size = 1.5 * max(np.abs(own.measured[:, half]).max(), (3.0, 0.5)[k // 3])
        drawn = ((own.measured[:, k], "sensor", 4), (own.found[ESTIMATES[1]][:, k], "eq. 8", 1),
                 (own.found[ESTIMATES[2]][:, k], "ours", 0))  # fmt: skip
        curves = tuple(
            Curve(words, own.t, np.clip(values, -size, size), colour=colour)
            for values, words, colour in drawn
        )
        panels.append(Panel(component[:2], "time [s]", component[4:-1], curves))
    caption = (
        f"The wrench at the tool of the first seed, {name}, axes of the base (figs. 9 and 10): by "
        "the sensor, by eq. 8 with our model, and ours. Values beyond 1.5 times the largest "
        "measured one are cut off."
    )
    return Picture(f"wrench-{name}", caption, tuple(panels))


SHORT_LOGS = {"UR10e": (3.0, 10.0, 30.0), "AR5": (5.0, 10.0, 30.0)}
QUICK_LOGS = {"UR10e": (10.0,), "AR5": (10.0,)}
"""Seconds of the fitted part of a measured robot's log; ours refuses 3 s of the AR5 as too few."""

STEP, FIRST_ROW = 0.01066, 500
"""Mean time from row to row in the log of the UR10e [s], and the row from which it moves."""

LOADED, CARRIED = "ur-20_02_19_14harm50secLoad", 2.805
"""The UR10e's log with a load, and its mass [kg] as the source of the data states it."""


@dataclass(frozen=True)
class Short:
    """What the methods gave from a short log of a measured robot.

    Attributes:
        robot: Its name.
        seconds: Length of the log [s].
        fit: Errors on it by method.
        test: Errors on unseen motion by method.
        indefinite: Share of the postures of the unseen motion with an indefinite mass matrix.
        load: Mass of the load and half its 95 % interval by method [kg], `None` of a model that
            `identify_payload` refuses; empty for the AR5, which carries none.
    """

    robot: str
    seconds: float
    fit: dict[str, ErrorsOnLog]
    test: dict[str, ErrorsOnLog]
    indefinite: dict[str, float]
    load: dict[str, tuple[float, float] | None]


def measured(folder: Path, quick: bool) -> Section:
    """Least squares, the convex program and ours on short logs of a UR10e and of an AR5."""
    found = tuple(
        short(robot, seconds, folder / f"{robot}_{seconds:g}_s", quick)
        for robot, lengths in (QUICK_LOGS if quick else SHORT_LOGS).items()
        for seconds in lengths
    )
    of_joints = (
        percent_table(f"{one.robot}: error on unseen motion after {one.seconds:g} s", one.test)
        for one in found
        if one.seconds == QUICK_LOGS[one.robot][0]
    )
    tables = (measured_errors(found), *of_joints, measured_bodies(found))
    loads = () if quick else (measured_loads(found),)
    parts = (Text(HEADING, MEASURED), measured_verdicts(found), *tables, *loads)
    return Section(parts, () if quick else measured_claims(found))


def short(robot: str, seconds: float, folder: Path, quick: bool) -> Short:
    """Identify a measured robot from a short log by all methods."""
    if robot == "UR10e":
        file, unseen, loaded = "ur10e", log(UR10E_PROCESS), ur10e(LOADED)
        (fitted,) = ur10e("ur-20_02_12-40sec_12harm")
        fitted += f"#{FIRST_ROW}:{FIRST_ROW + round(seconds / STEP)}"
    else:
        file, unseen, loaded = "rokae_ar5", log(AR5, "@34:45"), []
        fitted = log(AR5, f"@0:{seconds:g}")
    nominal = EXAMPLES / f"{file}.toml"
    boxes = [BOXES[0]] * len(steelyard.load_robot(nominal).robot.bodies)
    tables = {
        "OLS": UNKNOWN + PRINTED + LEAST_SQUARES,
        "convex": UNKNOWN + PRINTED + known(nominal, boxes),
        "ours": "",
    }
    models = {}
    for method in METHODS:
        changed = example(file, folder / f"{method}.toml", tables[method])
        models[method] = steelyard.identify(changed, fitted, check=False, threads=1).model
    postures = samples(nominal, unseen).motion.q
    return Short(
        robot,
        seconds,
        errors_on(models, fitted, like="ours"),
        errors_on(models, unseen, like="ours"),
        {method: indefinite(model, postures) for method, model in models.items()},
        {name: weighed(one, loaded) for name, one in models.items() if loaded and not quick},
    )


def weighed(model: steelyard.IdentifiedModel, loaded: Sequence[str]) -> tuple[float, float] | None:
    """Mass of a load, and half its 95 % interval [kg]; none of a model that it refuses."""
    try:
        found = steelyard.identify_payload(model, loaded, "tool0").to_dict()
    except steelyard.SteelyardError:
        return None
    return found["mass"], found["mass_half_width"]


MEASURED = (
    "UR10e (motor currents times published gains): the first seconds of one Fourier motion are "
    "fitted; unseen is the motion from point to point through ten postures, and "
    f"another Fourier motion with a load of {CARRIED} kg. AR5 (joint torque sensors): the first "
    "seconds of its run, 5 at least, as ours refuses 3 s as too few; unseen are the seconds 34 to "
    "45.",
    "All methods have the terms of the robot files in examples/ (Coulomb and viscous friction, "
    "offsets, rotors of the UR10e), so that estimators and signals alone differ. Least squares and "
    "the convex program have the settings of the paper as above, the convex program bounds of "
    f"masses ({LIGHT:g} to {HEAVY:g} times those of the model file) and centres (boxes of "
    f"{2.0 * BOXES[0]:g} m about its own). Ours has its defaults: no bounds, but the bodies of the "
    "model file as a prior. All are compared on the same signals, those of ours.",
)


def average(errors: ErrorsOnLog) -> float:
    """Mean absolute error, mean of the joints, as in tables 5 and 6 [Nm]."""
    return float(np.mean(errors.absolute))


def measured_errors(found: Sequence[Short]) -> Table:
    """Tables 5 and 6 of measured robots."""
    rows = tuple(
        (f"{one.robot}, {one.seconds:g} s, {words}",)
        + tuple(f"{average(by[m]):.3g} ({by[m].percent[-1]:.3g} %)" for m in METHODS)
        for one in found
        for words, by in (("fitted", one.fit), ("unseen", one.test))
    )
    title = (
        "Mean absolute error, mean of the joints [Nm], in brackets the error of all joints "
        "relative to the effort used"
    )
    return Table(title, rows, ("", *HEADINGS))


def measured_bodies(found: Sequence[Short]) -> Table:
    """Whether the mass matrix is possible."""
    rows = tuple(
        (
            f"{one.robot}, {one.seconds:g} s",
            *(f"{100.0 * x:.3g} %" for x in one.indefinite.values()),
        )
        for one in found
    )
    title = "Postures of the unseen motion with an indefinite mass matrix"
    return Table(title, rows, ("", *HEADINGS))


def measured_loads(found: Sequence[Short]) -> Table:
    """Mass of the load."""
    rows = tuple(
        (f"{one.robot}, {one.seconds:g} s", *(of_load(one.load[m]) for m in METHODS))
        for one in found
        if one.load
    )
    title = f"Load of {CARRIED} kg [kg], with 95 % interval, by models of the first seconds"
    return Table(title, rows, ("", *HEADINGS))


def of_load(load: tuple[float, float] | None) -> str:
    """A mass and its interval in words."""
    if load is None:
        return "refused: the model does not describe this log"
    return f"{load[0]:.3f} ± {load[1]:.3f}"


def measured_verdicts(found: Sequence[Short]) -> Table:
    """The paper's claims on measured robots."""

    def each(values: Sequence[float], unit: str = "") -> str:
        return ", ".join(
            f"{one.robot} {one.seconds:g} s {value:.3g}{unit}"
            for one, value in zip(found, values, strict=True)
        )

    def holds(true: Sequence[bool]) -> str:
        return "yes" if all(true) else "partly" if any(true) else "no"

    def rise(method: str) -> list[float]:
        return [average(one.test[method]) / average(one.fit[method]) for one in found]

    rises = zip(rise("OLS"), rise("convex"), strict=True)
    fit = [average(one.fit["OLS"]) / average(one.fit["convex"]) for one in found]
    test = [average(one.test["OLS"]) / average(one.test["convex"]) for one in found]
    ours = [average(one.test["ours"]) / average(one.test["convex"]) for one in found]
    impossible = [100.0 * one.indefinite["OLS"] for one in found]
    rows = (
        (
            "both methods predict the identification motion equally well",
            holds([abs(x - 1.0) <= 0.1 for x in fit]),
            f"error of least squares over that of the convex program {each(fit)}",
        ),
        (
            "on test motions the convex program is largely better than least squares",
            holds([x > 1.2 for x in test]),
            f"error of least squares over that of the convex program {each(test)}; "
            f"of ours over that of the convex program {each(ours)}",
        ),
        (
            "on test motions the error of least squares almost doubles, that of the convex program "
            "stays",
            holds([a >= 1.7 and b <= 1.3 for a, b in rises]),
            "error on unseen motion over that on the fitted one: least squares "
            f"{each(rise('OLS'))}; convex {each(rise('convex'))}",
        ),
        (
            "the convex program's bodies are consistent, those of least squares are not",
            holds([x > 0.0 for x in impossible]),
            f"postures in which the mass matrix of least squares is indefinite "
            f"{each(impossible, ' %')}",
        ),
    )
    columns = ("the paper", "holds there", "figure")
    return Table("What the paper claims, and whether it holds on measured robots", rows, columns)


def measured_claims(found: Sequence[Short]) -> tuple[Claim, ...]:
    """Bounds of measured robots."""
    arm = [one for one in found if one.robot == "UR10e"]
    short_logs = [one for one in found if one.seconds <= 10.0]
    order = [average(one.test["OLS"]) / average(one.test["convex"]) for one in short_logs]
    ours = [average(one.test["ours"]) / average(one.test["convex"]) for one in arm]
    loads = [one.load["ours"] for one in arm]
    covered = [x is not None and abs(x[0] - CARRIED) <= x[1] for x in loads]
    return (
        Claim("measured robots: test error after at most 10 s, least squares over convex, least",
              f"{min(order):.3g}", ">= 1.1", min(order) >= 1.1),
        Claim("measured UR10e: test error, ours over the paper's method, greatest",
              f"{max(ours):.3g}", "< 1", max(ours) < 1.0),
        Claim(f"measured UR10e: load of {CARRIED} kg in our interval, models of 3, 10 and 30 s",
              ", ".join(map(of_load, loads)), "all", all(covered)),
    )  # fmt: skip


STUDY = Study("p3", one, page, measured)

if __name__ == "__main__":
    run(STUDY)
