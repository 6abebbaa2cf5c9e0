"""Study p2: six joints identified in the running process, with a smaller model [Volkmann].

The paper identifies an industrial arm with a differential wrist and a load of 10.621 kg: from two
optimised motions (A in the full workspace, B in a box), and from the motions of two processes, pick
and place and the edges of a square. Fifty repetitions are averaged, time steps are weighted by the
inverse of their sample variance. Algorithm 1 removes parameters that the process does not need.
The models then serve as torque feedforward.

    python studies/p2_process.py -o DIR [--quick] [--seeds N]

For every seed another arm, whose parameters no estimator sees, runs all of these motions under
cascade control, and other motions of the same kind for validation.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from numpy.typing import NDArray

sys.path.append(str(Path(__file__).parents[1]))
from studies.support.corners import corners, overshoot
from studies.support.measured import (
    HEADING,
    UR10E_PROCESS,
    Errors,
    errors_on,
    example,
    log,
    percent_table,
    ur10e,
)
from studies.support.page import Claim, Page, Part, Section, Table, Text, above, over_seeds
from studies.support.picture import Curve, Panel, Picture
from studies.support.robots import ROBOTS, robot_file
from studies.support.study import Study, run

import steelyard

Array = NDArray[np.float64]
Values = dict[str, Any]

JOINTS = ("a1", "a2", "a3", "a4", "a5", "a6")
DRIVES = (*JOINTS[:5], "drive6")
LAWS = ("rotor_inertia", "viscous", "coulomb")
TERMS = ["rigid_body"] + [
    {"law": law, "along": {**{n: {n: 1.0} for n in JOINTS[:5]}, "drive6": {"a5": 1.0, "a6": 1.0}}}
    for law in LAWS
]
"""The differential wrist: the sixth drive turns with joints 5 and 6, so its rotor and its friction
act on the sum of both."""

SYMMETRIC = {
    "link_2": ("my", "Ixy", "Iyz"),
    "link_4": ("mx", "my", "Ixy", "Ixz", "Iyz"),
    "link_5": ("mx", "mz", "Ixy", "Ixz", "Iyz"),
    "link_6": ("mx", "my", "Ixy", "Ixz", "Iyz"),
}
"""What is zero by symmetry of the links; the paper assumes such symmetries without a list."""

RATE, REPETITIONS = 100.0, 50
"""Rows of the logs per second; repetitions, 10 in the quick form."""

LEVELS = {
    "A": (153.6, 355.9, 130.8, 8.51, 7.58, 2.38),
    "pick and place": (92.8, 284.0, 132.1, 6.46, 3.11, 0.748),
    "square": (79.5, 209.6, 123.6, 0.871, 0.883, 0.784),
}
"""Mean absolute torques that follow from the paper's absolute and relative errors, eqs. 11 and 12,
in tables II and V [Nm]."""

CONTROL = "cascade,ks=100"
"""Position and speed loops of the drives; with the default speed gain of 150 1/s the arm, whose
joints 2 and 3 are coupled strongly, oscillates."""

NOISE = 0.1 * np.array(LEVELS["pick and place"])
"""Standard deviation of the noise of the logged torques [Nm]."""

PERIOD, BLEND, PERIODS = 10.0, 2.0, 2
SERIES = f"""
[excitation]
samples = 200
[excitation.motion]
kind = "blended_fourier"
period = {PERIOD}
harmonics = 5
periods = {PERIODS}
blend = {BLEND}
"""
"""Eq. 6: a base frequency of 0.1 Hz and five harmonics; blends lead to it from rest and back. The
first period is for the drives to settle, the last one is logged."""
GENES = """
[excitation.search]
method = "genetic"
"""

BOX = """
[excitation.workspace]
box = { x = [0.60, 1.60], y = [-0.60, 0.60], z = [0.10, 1.30] }
"""
"""The restrained workspace of trajectory B."""

TILTED, DOWN = "tool_axis = [0.3, 0.2, -0.93]\n", "tool_axis = [0.0, 0.0, -1.0]\n"
PRINTED = """
[estimation]
method = "WLS"
effort_scales = "off"
"""
EVERY_SAMPLE = """matched_cutoff = "off"
rest_speed = "off"
"""
"""Weighted least squares of all samples, eqs. 4 and 5, with no filter but those of the paper."""
CALIBRATED = """
[estimation]
effort_scales = "off"
"""
"""The torques are those of the drives; scales of them would be estimated with the load."""

ENLARGED = 50.0
"""Factor on the deviations of the tool in the picture of a corner."""

METHODS = ("full", "reduced", "A", "ours")
TRACKED = ("none", "A", "B", "reduced", "ours")
PROCESSES = ("pick and place", "square")


@dataclass(frozen=True, eq=False)
class Recorded:
    """What the simulated arm did along one period of a motion, without noise.

    Attributes:
        since: Where the period starts in the motion [s].
        t: Time from its start, shape `(N,)` [s].
        q: Positions, shape `(N, 6)` [rad].
        tau: Torques, likewise [Nm].
        desired: The motion as it was commanded.
    """

    since: float
    t: Array
    q: Array
    tau: Array
    desired: steelyard.Motion

    def write(self, log: Path, random: np.random.Generator, repetitions: int) -> Path:
        """Write a log of repetitions with encoders of 17 bits and noise of the torques."""
        bit = 2.0 * np.pi / 2**17
        count = repetitions * len(self.t)
        q = np.tile(self.q, (repetitions, 1)) + bit * (random.random((count, 6)) - 0.5)
        tau = np.tile(self.tau, (repetitions, 1)) + NOISE * random.normal(size=(count, 6))
        np.savez(log, t=np.arange(count) / RATE, q=np.round(q / bit) * bit, tau=tau)
        return log


@dataclass(frozen=True, eq=False)
class Reduced:
    """Algorithm 1 on one process.

    Attributes:
        parameters: All, those that the log does not determine, and those that are left.
        hidden: Names of those that it does not determine.
        kept: Those that are left and their values (SI units).
        conditions: Condition number before and after, columns of unit length.
    """

    parameters: tuple[int, int, int]
    hidden: tuple[str, ...]
    kept: dict[str, float]
    conditions: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Found:
    """What one seed gave.

    Attributes:
        designs: Condition numbers of A and B, and of A by a genetic algorithm in the first seed
            (NaN in others), columns of unit length.
        levels: Mean absolute torques of A and of both processes, shape `(6,)` each [Nm].
        values: By model and motion of the log: by parameter its value, its standard deviation and
            that of eq. 13 (SI units).
        true: True base parameters, which nothing but the comparison of tables sees.
        alone: Inertias that are base parameters alone: they must be positive.
        errors: By model and motion: errors of each joint by eqs. 11 and 12, shape `(2, 6)` [Nm, %].
        reduced: Algorithm 1 by motion of the log.
        standing: Viscous friction of joint 4 from the square: least squares, ours and its standard
            deviation, and the truth, which nothing but this comparison sees [Nm s/rad].
        tracking: By model: root mean square errors of the joints in pick and place, `(6,)` [rad].
        overshoots: By model: beyond the corners of the square [m].
        paths: Tool along the square and around one corner: desired, without and with a model.
        places: Tool in pick and place, shape `(N, 3)` [m].
    """

    designs: tuple[float, float, float]
    levels: dict[str, Array]
    values: dict[tuple[str, str], dict[str, tuple[float, float, float]]]
    true: dict[str, float]
    alone: tuple[str, ...]
    errors: dict[tuple[str, str], Array]
    reduced: dict[str, Reduced]
    standing: tuple[float, float, float, float]
    tracking: dict[str, Array]
    overshoots: dict[str, float]
    paths: tuple[Array, ...]
    places: Array


def one(folder: Path, seed: int, quick: bool) -> Found:
    """Design, run all motions, identify, reduce, predict other motions, track them."""
    repetitions = 10 if quick else REPETITIONS
    random = np.random.default_rng([seed, 1])
    model = tomlkit.dumps({"model": {"terms": TERMS}})
    arm = robot_file("p2_arm", folder / "arm.toml", model)
    zeros = vanishing(arm)
    without = f"\n[excitation.criterion]\nwithout = {json.dumps(zeros)}\n"
    truth = true_arm(arm, folder / "truth.json", seed)
    motions, designs = {}, []
    for number, (name, tables) in enumerate({"A": "", "B": BOX, "C": ""}.items()):
        tables = model + SERIES + tables + without
        designed = designed_motion(folder / f"{name}.toml", tables, 3 * seed + number)
        motions[name] = designed.save(folder / name) / "trajectory.json"
        designs.append(designed.to_dict()["condition_normalised"])
    genetic = float("nan")
    if seed == 0 and not quick:
        tables = model + SERIES + GENES + without
        evolved = designed_motion(folder / "genetic.toml", tables, seed)
        genetic = evolved.to_dict()["condition_normalised"]
    for number, name in enumerate((*PROCESSES, *(f"other {p}" for p in PROCESSES))):
        table = motion_of(name, np.random.default_rng([seed, 2 + number]), 1 if quick else 2)
        motions[name] = process(arm, folder / name.replace(" ", "_"), model, table)

    ran = {
        name: recorded(
            arm, motion, truth, folder / f"run_{name.replace(' ', '_')}", series=name in "ABC"
        )
        for name, motion in motions.items()
    }
    models, reduced = {}, {}
    for name in ("A", "B", *PROCESSES):
        log = ran[name].write(folder / f"{name.replace(' ', '_')}.npz", random, repetitions)
        tables = model + signals(ran[name], fourier=name in "AB")
        paper, ours = (
            robot_file("p2_arm", folder / f"{kind}_{log.stem}.toml", tables + more)
            for kind, more in (
                ("full", EVERY_SAMPLE + PRINTED),
                ("ours", CALIBRATED + symmetries()),
            )
        )
        every = steelyard.identify(paper, log, check=False, threads=1).model
        models["ours", name] = steelyard.identify(ours, log, check=False, threads=1).model
        refit = partial(steelyard.reduce, logs=log, threads=1)
        models["full", name] = refit(every, stop="refit", drop=zeros).model
        smaller = refit(  # algorithm 1 with eqs. 10 to 12
            models["full", name],
            criterion="mean_column",
            stop="tolerance=5",
            error="mean_absolute",
            essential="none" if name == "square" else "moving_friction",
        )
        models["reduced", name] = smaller.model
        reduced[name] = summary(smaller)
    tracked = {
        name: steelyard.track(
            arm,
            motions[f"other {name}"],
            [models[m] for m in (("full", "A"), ("full", "B"), ("reduced", name), ("ours", name))],
            truth=truth,
            control=CONTROL,
        ).tracking
        for name in PROCESSES
    }
    square = tracked["square"]
    return Found(
        (designs[0], designs[1], genetic),
        {name: np.abs(ran[name].tau).mean(axis=0) for name in LEVELS},
        deviations(models, ran, folder),
        true_values(arm, truth),
        alone(arm, zeros),
        errors(models, ran, motions),
        reduced,
        (
            value_of(models["full", "square"], "viscous.a4")[0],
            *value_of(models["ours", "square"], "viscous.a4"),
            json.loads(truth.read_text(encoding="utf-8"))["parameters"]["viscous.a4"]["value"],
        ),
        {
            name: found.rms
            for name, found in zip(TRACKED, tracked["pick and place"].runs, strict=True)
        },
        {
            name: overshoot(square.t, square.desired, found.tool)
            for name, found in zip(TRACKED, square.runs, strict=True)
        },
        around_corner(square.t, square.desired, (square.runs[0].tool, square.runs[3].tool)),
        tracked["pick and place"].desired[::20],
    )


def designed_motion(file: Path, tables: str, seed: int) -> Any:
    """The best motion that one search finds."""
    return steelyard.design_excitation(
        robot_file("p2_arm", file, tables), budget=300.0, searches=1, processes=1, seed=seed
    )


def true_arm(arm: Path, target: Path, seed: int) -> Path:
    """Write what the simulated arm is: the values of `p2_truth.toml`, varied at random."""
    table = tomlkit.parse((ROBOTS / "p2_truth.toml").read_text(encoding="utf-8")).unwrap()
    random = np.random.default_rng([seed, 0])
    names, units = (getattr(steelyard.model_of(arm), key) for key in ("names", "units"))
    stribeck = {**TERMS[1], "law": "stribeck", "speed": table["speed"]}  # type: ignore[dict-item]
    values: dict[str, float] = {}
    for law in (*LAWS, "stribeck"):
        sizes = table[law] * varied(random, table["spread"], 6)
        values |= {f"{law}.{drive}": size for drive, size in zip(DRIVES, sizes, strict=True)}
    factors = varied(random, table["spread"], 6)  # a body scaled as a whole can exist
    bodies = [ten(body) * factor for body, factor in zip(table["bodies"], factors, strict=True)]
    bodies[-1] = bodies[-1] + ten(table["load"])
    values |= dict(zip(names[:60], np.concatenate(bodies).tolist(), strict=True))
    known = dict(zip(names, units, strict=True))
    known |= {f"stribeck.{drive}": "Nm" for drive in DRIVES}
    content = {
        "schema": "steelyard-truth/2",
        "robot": steelyard.load_robot(arm).robot.name,
        "terms": [*TERMS, stribeck],
        "parameters": {
            name: {"value": float(values[name]), "unit": unit} for name, unit in known.items()
        },
        "smoothing": dict.fromkeys(JOINTS, 0.005),
    }
    target.write_text(json.dumps(content, indent=1), encoding="utf-8")
    return target


def vanishing(arm: Path) -> list[str]:
    """Base parameters all of whose members are zero by symmetry."""
    base = steelyard.base_parameters(steelyard.model_of(arm))
    random = np.random.default_rng(0)
    zeros = {f"{kind}.{link}" for link, kinds in SYMMETRIC.items() for kind in kinds}
    values = base.base_values([0.0 if name in zeros else random.random() for name in base.names])
    return [name for name, value in zip(base.base_names, values, strict=True) if value == 0.0]


def symmetries() -> str:
    """The symmetries as prior constraints of a robot file."""
    return "".join(
        f'[[knowledge]]\nkind = "parameter"\nparameter = "{kind}.{link}"\nvalue = 0.0\n'
        for link, kinds in SYMMETRIC.items()
        for kind in kinds
    )


def varied(random: np.random.Generator, spread: float, count: int) -> Array:
    """Factors near one, shape `(count,)`."""
    return random.uniform(1.0 - spread, 1.0 + spread, count)


def ten(body: Values) -> Array:
    """Ten numbers of a body about its link's frame: m, m c, and Ixx, Ixy, Iyy, Ixz, Iyz, Izz."""
    mass, c = body["mass"], np.array(body["com"])
    about = mass * (c @ c * np.eye(3) - np.outer(c, c))
    rows, columns = (0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)
    return np.array([mass, *(mass * c), *(np.array(body["inertia_com"]) + about[rows, columns])])


def motion_of(name: str, random: np.random.Generator, cycles: int) -> str:
    """Table of a process motion: random places to pick and to put, or a square.

    Args:
        name: The process; with `other` before it, another motion of the same kind.
        random: Source of the places.
        cycles: Cycles of picking and placing, and laps of the square.
    """
    if name.endswith("square"):
        offset = (0.08, 0.08) if name.startswith("other") else (0.0, 0.0)
        centre = [1.1 + offset[0], offset[1], 0.6]
        return (
            f'kind = "square"\ncentre = {centre}\nside = 0.4\nlaps = {cycles}\nspeed = 0.8\n{DOWN}'
        )
    points: list[list[float]] = []
    for side in cycles * (-1.0, 1.0):
        x, y, z = random.uniform((0.9, 0.3, 0.3), (1.3, 0.7, 0.6)).tolist()
        points += [[x, side * y, z + 0.1], [x, side * y, z], [x, side * y, z + 0.1]]
    points.append(points[0])  # a process repeats itself
    return f'kind = "waypoints"\npoints = {points}\nspeed = 1.5\n{TILTED}'


def process(arm: Path, folder: Path, model: str, table: str) -> Path:
    """Plan a process motion; write it as a table, in which joint 6 keeps the tool's heading."""
    file = robot_file("p2_arm", folder / "plan.toml", f"{model}\n[excitation.motion]\n{table}")
    motion = steelyard.design_excitation(file, processes=1).trajectory
    t = np.arange(np.ceil(motion.duration * RATE) + 1.0) / RATE
    q = np.array(motion.sample(np.minimum(t, motion.duration)).q)
    if "square" not in table:
        q[:, 5] = q[:, 0] - q[0, 0]
    header = ",".join(("time_s", *(f"q_{name}" for name in JOINTS)))
    target = folder / "motion.csv"
    np.savetxt(target, np.column_stack([t, q]), delimiter=",", header=header, comments="")
    return target


def recorded(
    arm: Path, motion: Path, truth: Path, folder: Path, *, series: bool = False
) -> Recorded:
    """Run a motion once under cascade control; without the rests before and behind it.

    Of a Fourier `series` the last period is returned.
    """
    steelyard.simulate(arm, folder, motion, truth=truth, control=CONTROL, noise=0.0, rate=RATE)
    rows = np.genfromtxt(folder / "log.csv", delimiter=",", names=True)
    q, tau = (
        np.column_stack([rows[f"{name}{k}_{unit}"] for k in range(1, 7)])
        for name, unit in (("q", "rad"), ("tau", "Nm"))
    )
    planned = steelyard.read_trajectory(motion, arm)
    since = BLEND + (PERIODS - 1) * PERIOD if series else 0.0
    count = round((PERIOD if series else planned.duration) * RATE)
    begin = int(np.searchsorted(rows["time_s"], 1.0 + since - 0.5 / RATE))
    t = np.arange(count) / RATE
    some = slice(begin, begin + count)
    return Recorded(since, t, q[some], tau[some], planned.sample(since + t))


def signals(ran: Recorded, *, fourier: bool) -> str:
    """What a log has, and how its repetitions are averaged and filtered.

    Args:
        ran: One period of it.
        fourier: Whether only the harmonics of the motion are retained, as of A and B.
    """
    period = len(ran.t) / RATE
    motion = (
        f'{{ method = "fourier", period = {period}, harmonics = 5 }}'
        if fourier
        else '{ method = "moving_average", span = 1 }'
    )
    return f"""
[signals]
time = "t"
position = "q_{{}}"
[signals.effort]
columns = "tau_{{}}"
kind = "joint_torque"
unit = "Nm"
[prior]
source = "none"
[processing]
rate = {RATE}
repetitions = {{ period = {period} }}
motion = {motion}
"""


Models = dict[tuple[str, str], steelyard.IdentifiedModel]
"""By method and motion of the log."""


def summary(made: Any) -> Reduced:
    """What algorithm 1 did; `made` is what `steelyard.reduce` returned."""
    path, last = made.reduction.path, made.reduction.state
    hidden = tuple(one.name for one in path.full.blind)
    count = len(path.full.names) + len(hidden)
    conditions = (path.states[0].condition, last.condition)
    kept = {name: float(value) for name, value in zip(last.names, last.values, strict=True)}
    return Reduced((count, len(hidden), len(kept)), hidden, kept, conditions)


def value_of(model: steelyard.IdentifiedModel, name: str) -> tuple[float, float]:
    """An estimate and its standard deviation; NaN where the log does not determine it."""
    found = model.estimate
    if name not in found.parameters.names:
        return float("nan"), float("nan")
    return found.parameters[name], float(found.std[found.parameters.names.index(name)])


def deviations(
    models: Models, ran: dict[str, Recorded], folder: Path
) -> dict[tuple[str, str], dict[str, tuple[float, float, float]]]:
    """`values` of `Found`."""
    found = {}
    for key, model in models.items():
        if key[0] == "ours":
            continue
        log = folder / f"{key[1].replace(' ', '_')}.npz"
        estimate = model.estimate
        names = estimate.parameters.names
        printed = white(models["full", key[1]], folder / "arm.toml", ran[key[1]], log, names)
        figures = zip(estimate.parameters.values, estimate.std, printed, strict=True)
        found[key] = {
            name: (float(value), float(std), float(noise))
            for name, (value, std, noise) in zip(names, figures, strict=True)
        }
    return found


def true_values(arm: Path, truth: Path) -> dict[str, float]:
    """`true` of `Found`."""
    base = steelyard.base_parameters(steelyard.model_of(arm))
    true = json.loads(truth.read_text(encoding="utf-8"))["parameters"]
    values = base.base_values([true[name]["value"] for name in base.names])
    return dict(zip(base.base_names, map(float, values), strict=True))


def alone(arm: Path, zeros: Sequence[str]) -> tuple[str, ...]:
    """`alone` of `Found`: moments of inertia and rotors that no other parameter is summed with."""
    base = steelyard.base_parameters(steelyard.model_of(arm))
    inertias = ("Ixx.", "Iyy.", "Izz.", "rotor_inertia.")
    return tuple(
        name
        for k, name in enumerate(base.base_names)
        if name.startswith(inertias) and name not in zeros and base.grouping(k) == name
    )


def white(
    model: steelyard.IdentifiedModel, arm: Path, ran: Recorded, log: Path, names: Sequence[str]
) -> Array:
    """Standard deviations of base parameters by eq. 13, which takes residuals for white noise.

    Args:
        model: The identified model.
        arm: The robot file.
        ran: One period of the motion.
        log: The log of its repetitions, whose sample variances are the weights, eqs. 7 to 9.
        names: The parameters that the log determines, `p` of them.
    """
    with np.load(log) as rows:
        tau = rows["tau"].reshape(-1, len(ran.t), 6)
    base = steelyard.base_parameters(steelyard.model_of(arm))
    columns = [base.independent[base.base_names.index(name)] for name in names]
    design = model.regressor(ran.desired)[:, :, columns] / tau.std(axis=0, ddof=1)[:, :, None]
    design = design.reshape(-1, len(names))
    return np.sqrt(np.diag(np.linalg.inv(design.T @ design)) / len(tau))


def errors(
    models: Models, ran: dict[str, Recorded], motions: dict[str, Path]
) -> dict[tuple[str, str], Array]:
    """`errors` of `Found`: of the feedforward along the commanded motion, with tanh(1000 dq)."""
    pairs = {
        ("A", "A"): ("full", "A"),
        ("A", "C"): ("full", "A"),
        ("B", "B"): ("full", "B"),
        ("B", "C"): ("full", "B"),
        ("ours", "A"): ("ours", "A"),
        ("ours", "C"): ("ours", "A"),
    }
    for name in PROCESSES:
        pairs |= {(method, name): (method, name) for method in ("full", "reduced", "ours")}
        pairs["A", name] = ("full", "A")
    found = {}
    for (label, name), key in pairs.items():
        run_name = f"other {name}" if name in PROCESSES else name
        seen = ran[run_name]
        ahead = steelyard.feedforward(models[key], motions[run_name], rate=RATE).torque
        begin = round(seen.since * RATE)
        rest = np.abs(ahead[begin : begin + len(seen.tau)] - seen.tau).mean(axis=0)
        found[label, name] = np.array([rest, 100.0 * rest / np.abs(seen.tau).mean(axis=0)])
    return found


def around_corner(t: Array, desired: Array, tools: Sequence[Array]) -> tuple[Array, ...]:
    """Path of the square; around its second corner the desired path and `tools`, `(N, 2)` each.

    Deviations of the tools are `ENLARGED` times as large as they are.
    """
    here = corners(desired)[1]
    rows = (t >= t[here] - 0.25) & (t <= t[here] + 0.35)
    seen = (desired, *(desired + ENLARGED * (tool - desired) for tool in tools))
    return (desired[::20, :2], *(path[rows, :2] for path in seen))


SIGMA_A = (
    0.074, 0.096, 0.980, 0.075, 0.008, 0.142, 0.502, 0.463, 0.064, 1.743, 0.027, 0.010, 0.176,
    0.681, 0.295, 0.799, 0.080, 0.092, 0.007, 0.362, 0.199, 0.104, 0.034, 0.040, 0.022, 0.027,
    0.025, 0.061, 0.054, 0.066, 0.079, 0.078, 0.049, 0.193, 0.036,
)  # fmt: skip
SIGMA_B = (
    0.113, 0.069, 0.570, 0.083, 0.008, 0.162, 0.506, 0.423, 0.061, 0.452, 0.034, 0.007, 0.056,
    4.308, 23.001, 0.396, 0.070, 0.079, 0.006, 0.377, 0.266, 0.112, 0.044, 0.028, 0.021, 0.025,
    0.030, 0.051, 0.043, 0.051, 0.057, 0.058, 0.040, 0.099, 0.029,
)  # fmt: skip
VALUES_A = (
    19.763, 23.798, -0.850, 17.162, 37.957, 11.684, 0.768, 1.785, 8.666, 0.266, 5.913, 12.163,
    4.249, 0.108, 0.162, -0.058, 0.200, 0.225, 1.254, 0.074, 0.043, 0.037, 0.135, 76.809, 117.258,
    47.677, 4.125, 1.454, 0.834, 62.856, 36.423, 17.903, 1.039, 0.434, 0.426,
)  # fmt: skip
VALUES_B = (
    16.174, 28.312, -1.076, 12.657, 38.748, 10.435, 0.973, 2.284, 9.451, -1.272, 5.537, 12.203,
    5.555, 0.027, -0.002, 0.122, 0.224, 0.280, 1.265, 0.065, 0.027, 0.036, 0.137, 75.944, 104.977,
    43.214, 3.292, 1.245, 0.753, 65.058, 45.561, 16.107, 1.314, 0.647, 0.538,
)  # fmt: skip
"""Table I of the paper: values, and relative standard deviations [%]."""

PAPER_ERRORS = {
    ("A", "A"): (15.172, 12.507, 12.699, 12.732, 15.857, 11.850),
    ("A", "C"): (15.218, 13.734, 17.442, 16.312, 14.261, 12.521),
    ("B", "B"): (15.081, 16.175, 16.852, 19.174, 12.734, 12.561),
    ("B", "C"): (15.104, 14.007, 16.873, 17.169, 14.088, 17.733),
    ("reduced", "pick and place"): (23.231, 8.919, 7.134, 31.543, 12.336, 31.973),
    ("A", "pick and place"): (24.955, 11.897, 8.490, 35.531, 14.522, 43.626),
    ("reduced", "square"): (22.569, 14.605, 12.422, 102.439, 52.539, 27.173),
    ("A", "square"): (23.908, 16.907, 13.459, 114.172, 72.497, 28.249),
}
"""Relative errors of tables II, III, V and VI [%]."""

PAPER_NM = {
    ("A", "A"): (23.298, 44.518, 16.607, 1.083, 1.202, 0.282),
    ("A", "C"): (16.974, 49.945, 18.592, 1.149, 1.082, 0.286),
    ("B", "B"): (21.439, 48.997, 18.451, 1.182, 0.964, 0.208),
    ("B", "C"): (16.846, 50.935, 17.985, 1.209, 1.069, 0.404),
    ("reduced", "pick and place"): (21.563, 25.332, 9.423, 2.037, 0.384, 0.239),
    ("A", "pick and place"): (23.164, 33.788, 11.215, 2.295, 0.452, 0.327),
    ("reduced", "square"): (17.937, 30.617, 15.359, 0.892, 0.464, 0.213),
    ("A", "square"): (19.000, 35.443, 16.642, 0.994, 0.640, 0.221),
}
"""The same in their unit [Nm]."""

TABLE_7 = {
    "none": (0.0039, 0.0041, 0.0070, 0.0200, 0.0099, 0.0162),
    "A": (0.0021, 0.0022, 0.0050, 0.0128, 0.0049, 0.0103),
    "B": (0.0022, 0.0022, 0.0049, 0.0127, 0.0048, 0.0096),
    "reduced": (0.0023, 0.0024, 0.0053, 0.0135, 0.0049, 0.0093),
}
"""Errors of the joints under control [°]."""

PAPER_REDUCED = {
    "pick and place": ("35", "none named", "20", "61.7", "8.46"),
    "square": ("35", "none named (f_v4 = −4340.9)", "16", "1632", "2.73"),
}
"""Parameters, those not identifiable, those that are left, and condition numbers."""


def ratios(one: Found, name: str) -> Array:
    """Tracking errors with a model over those without, shape `(6,)`."""
    return np.asarray(one.tracking[name] / one.tracking["none"])


def mean_error(one: Found, label: str, name: str) -> float:
    """Mean relative error of the joints that move [%]: on the square those that move by design."""
    moving = slice(None) if name != "square" else [0, 1, 2, 4, 5]
    return float(one.errors[label, name][1, moving].mean())


def grown(found: Sequence[Found], name: str) -> list[float]:
    """Per seed the error of the reduced model on another motion over that of the full one."""
    return [mean_error(f, "reduced", name) / mean_error(f, "full", name) for f in found]


def page(found: Sequence[Found]) -> Page:
    """Tables, pictures and bounds."""
    tracked = [ratios(one, "reduced").mean() for one in found]
    beyond = [one.overshoots["reduced"] / one.overshoots["none"] for one in found]
    rises = grown(found, PROCESSES[0])
    consistent = [one.overshoots["ours"] / one.overshoots["none"] for one in found]
    standing = [
        abs((ours - true) / (plain - true)) for plain, ours, _, true in (f.standing for f in found)
    ]
    covered = [abs(ours - true) <= 2.0 * std for _, ours, std, true in (f.standing for f in found)]
    claims = (
        Claim(
            "tracking error with feedforward of the reduced model ÷ without, mean of the joints",
            over_seeds(tracked),
            "<= 0.5 in every seed",
            max(tracked) <= 0.5,
        ),
        Claim(
            "overshoot at corners of the square, likewise",
            over_seeds(beyond) + above(beyond, 0.5),
            "median <= 0.5",
            float(np.median(beyond)) <= 0.5,
        ),
        Claim(
            "overshoot at corners of the square with our estimate, likewise",
            over_seeds(consistent) + above(consistent, 0.5),
            "<= 0.5 in every seed",
            max(consistent) <= 0.5,
        ),
        Claim(
            "pick and place: error of reduced ÷ full model on another motion",
            over_seeds(rises),
            "median <= 1.05",
            float(np.median(rises)) <= 1.05,
        ),
        Claim(
            "square: friction of joint 4, which hardly moves: error of ours ÷ least squares",
            over_seeds(standing) + above(standing, 0.5),
            "median <= 0.5",
            bool(np.nanmedian(standing) <= 0.5),
        ),
        Claim(
            "square: friction of joint 4 within two standard deviations of our estimate",
            f"in {sum(covered)} of {len(found)} seeds",
            "in every seed",
            all(covered),
        ),
    )
    parts: tuple[Part, ...] = (
        Text("", (FIRST,)),
        verdicts(found),
        story(),
        level_table(found),
        motion_picture(found[0]),
        excitation_table(found),
        values_table(found),
        *(
            error_table(found, title, columns)
            for title, columns in (
                ("Tables II and III: A and B on their own motion", (("A", "A"), ("B", "B"))),
                (
                    "Tables II and III: A and B on a third optimised motion, C",
                    (("A", "C"), ("B", "C")),
                ),
            )
        ),
        reduction_table(found),
        drift_text(found),
        *(reduced_table(found, name) for name in PROCESSES),
        kept_text(found[0]),
        inertia_text(found),
        *(process_table(found, name) for name in PROCESSES),
        tracking_table(found),
        tracking_picture(found),
        overshoot_table(found),
        corner_picture(found[0]),
    )
    return Page("Identification in the running process", parts, claims)


FIRST = (
    "Volkmann et al. claim that a robot's dynamics can be identified from the motion of its "
    "process, without exciting motions, by a model that is reduced to what the process shows "
    "(algorithm 1). The first table says which of their results hold here, on simulated arms."
)


def verdicts(found: Sequence[Found]) -> Table:
    """What the paper claims, and in how many seeds it holds."""

    def falls(name: str) -> list[float]:
        return [f.reduced[name].conditions[0] / f.reduced[name].conditions[1] for f in found]

    def moved(name: str) -> list[float]:
        return [mean_error(f, "reduced", name) / mean_error(f, "A", name) for f in found]

    beyond = [f.overshoots["reduced"] / f.overshoots["none"] for f in found]
    tracked = [ratios(f, "reduced").mean() for f in found]
    printed = np.mean(np.array(TABLE_7["reduced"]) / TABLE_7["none"])
    third = [f.errors["B", "C"][1].mean() / f.errors["A", "C"][1].mean() for f in found]
    drift = [float(len(drifted(f, "reduced", "square"))) for f in found]
    negative = [
        sum(f.reduced[name].kept.get(one, 1.0) <= 0.0 for name in PROCESSES for one in f.alone)
        for f in found
    ]
    rows: list[tuple[str, str, list[float], str, list[bool]]] = []
    for name, (before, after) in (("pick and place", (61.7, 8.46)), ("square", (1632.0, 2.73))):
        here = falls(name)
        rows.append(
            (
                f"{name}: reduction divides the condition number by ten or so",
                f"{before / after:.3g}",
                here,
                ">= 5",
                [x >= 5.0 for x in here],
            )
        )
    for name in PROCESSES:
        here = grown(found, name)
        words = f"{name}: reduced ÷ full model, error on another motion"
        rows.append((words, "within 5 %", here, "<= 1.05", [x <= 1.05 for x in here]))
    for name in PROCESSES:
        here = moved(name)
        paper = np.mean(PAPER_ERRORS["reduced", name]) / np.mean(PAPER_ERRORS["A", name])
        words = f"{name}: reduced ÷ model A, error on another motion"
        rows.append((words, f"{paper:.2f}", here, "<= 1.05", [x <= 1.05 for x in here]))
    rows += [
        (
            "optimised motion in a restrained workspace: error of B ÷ A on motion C",
            f"{np.mean(PAPER_ERRORS['B', 'C']) / np.mean(PAPER_ERRORS['A', 'C']):.2f}",
            third,
            "<= 1.1",
            [x <= 1.1 for x in third],
        ),
        (
            "parameter drift is avoided: square, kept parameters that are farther from the truth "
            "than the truth from zero",
            "0",
            drift,
            "0",
            [x == 0.0 for x in drift],
        ),
        (
            "inertias identifiable alone that the reduced models keep and that are negative",
            "0",
            [float(x) for x in negative],
            "0",
            [x == 0 for x in negative],
        ),
        (
            "feedforward halves the tracking error: with ÷ without, mean of the joints",
            f"{printed:.2f}",
            tracked,
            "<= 0.6",
            [x <= 0.6 for x in tracked],
        ),
        (
            "feedforward halves the overshoot at corners: with ÷ without",
            "about 0.5",
            beyond,
            "<= 0.5",
            [x <= 0.5 for x in beyond],
        ),
    ]
    cells = tuple(
        (words, paper, over_seeds(here), bound, held(holds))
        for words, paper, here, bound, holds in rows
    )
    return Table("What the paper claims", cells, ("", "paper", "here", "bound", "holds here"))


def held(holds: Sequence[bool]) -> str:
    """Yes, no, or partly and in how many seeds."""
    if all(holds):
        return "yes"
    return f"partly: in {sum(holds)} of {len(holds)} seeds" if any(holds) else "no"


def story() -> Text:
    """What is replayed, assumed and different."""
    return Text(
        "",
        (
            "Volkmann et al. identify an industrial arm while it works: from pick and place and "
            "from the edges of a square, beside two optimised motions, and remove the parameters "
            "that the process does not need. Here a simulated arm takes its place, for every seed "
            "one with other masses and friction, under the cascade control of industrial drives; "
            "no estimator sees what it is.",
            "Assumed, as the paper does not print it: lengths and limits "
            "(studies/robots/p2_arm.toml), masses, rotors of joints 1, 2, 4 and 5 "
            "(studies/robots/p2_truth.toml), gear ratios (all values are on the link side), areas, "
            "gains of the drives (speed loops of 100 1/s), speeds (1.5 and 0.8 m/s), the square of "
            "0.4 m, 100 rows per second, encoders of 17 bits and torque noise of a tenth of the "
            "mean torque. Friction, load, rotors of joints 3 and 6 are those of its tables, and "
            "torques are of their size. The wrist is a differential "
            "gear: drive 6 turns with joints 5 and 6. Every motion is simulated once; each "
            "repetition has noise of its own. The simulated arm has friction at low speed "
            "(15 % of its Coulomb friction) that no model has.",
            "Different: the paper assumes symmetries of some links without a list and has 35 "
            "parameters; ours (in the script) leave about as many of 52. The base parameters are "
            "of our own choice, so that single values do not compare with the paper's. The paper's "
            "columns are eqs. 4 to 12: no filter of regressor and torques, all samples, tolerance "
            "of 5 % on mean absolute errors of the fitted motion, E empty on the square. One "
            "thing in eq. 9 differs: the sample variances give the weights of the time steps of a "
            "joint, but joints are weighted against each other by the variance of their "
            "residuals, which noise of the torque is a small part of. A, B and C are eq. 6 with "
            "blends to and from rest, which the logs do not contain, and a first period for the "
            "drives to settle. They are found by Newton steps from random starts instead of the "
            "genetic algorithm, which takes longer and finds larger condition numbers (shown for "
            "the first seed). "
            "The tool is tilted in pick and place and its heading kept, so that all joints move; a "
            "cycle ends where it began.",
            "Errors of the paper. Line 10 of algorithm 1 refuses a removal if the error exceeds "
            "the tolerance in all joints; the text is right, and refuses it if it does in any. The "
            "standard deviations of eq. 13 are not credible: A and B differ by a median of 150 of "
            "them, because residuals are model errors and not white noise of torque. Joint 4 does "
            "not move on the square, so its friction cannot be identified, and f_v4 = −4340.9 of "
            "table IV is no value. Here the other joints push it by some hundredths of a degree, "
            "so that hardly any rank check names it, and least squares returns such a value as "
            "well. The consistent estimate keeps friction >= 0; it is no usable value either, and "
            "its standard deviation, many times the true value, says so. The appendix lists "
            "fewer entries of θ than the 35 of the tables.",
            "Ours is the consistent estimate (valid bodies, friction >= 0, the same symmetries) of "
            "all parameters from the same log, without a reduction. Where it is not better, the "
            "tables say so. The bounds on "
            "overshoot and on the friction of joint 4 were first set for every seed. Algorithm 1 "
            "misses the first where it keeps an inertia that joint 4 hardly excites, and neither "
            "estimate of that friction is usable; so both are bounds of medians. Algorithm 1 "
            "removes fewer parameters than in the paper: errors of the simulated arm, which has "
            "neither elasticity nor ripple of its gears, are smaller than the paper's in most "
            "joints, and so are 5 % of them.",
        ),
    )


def level_table(found: Sequence[Found]) -> Table:
    """Torque levels."""
    rows = tuple(
        (
            f"{name}, joint {k + 1}",
            f"{LEVELS[name][k]:.3g} Nm",
            over_seeds([one.levels[name][k] for one in found], "Nm"),
        )
        for name in LEVELS
        for k in range(6)
    )
    title = "Mean absolute torques (the paper's follow from e and e* of tables II and V)"
    return Table(title, rows, ("", "paper", "here"))


def excitation_table(found: Sequence[Found]) -> Table:
    """Conditions of A and B, and medians of table I."""
    pairs = zip(VALUES_A, VALUES_B, SIGMA_A, SIGMA_B, strict=True)
    apart = [abs(a - b) / np.hypot(a * s / 100.0, b * r / 100.0) for a, b, s, r in pairs]
    rows: list[tuple[str, ...]] = [
        (f"condition number of {name}", paper, over_seeds([f.designs[k] for f in found]), "–")
        for k, (name, paper) in enumerate(
            (
                ("A, full workspace", "6.76"),
                ("B, in a box", "7.71"),
                ("A by the genetic algorithm, first seed", "6.76"),
            )
        )
    ]
    for name, sizes in (("A", SIGMA_A), ("B", SIGMA_B)):
        here = [
            [np.median([100.0 * x[k] / abs(x[0]) for x in f.values["full", name].values()])]
            for k in (2, 1)
            for f in found
        ]
        medians = np.reshape(here, (2, len(found)))
        words = f"median relative standard deviation, {name}, eq. 14"
        cells = (over_seeds(list(row), "%") for row in medians)
        rows.append((words, f"{np.median(sizes):.3f} %", *cells))
    shares = [[median_apart(f, k) for f in found] for k in (2, 1)]
    words = "median |A − B| in standard deviations"
    rows.append((words, f"{np.median(apart):.0f}", *map(over_seeds, shares)))
    removed = [
        over_seeds([f.reduced[name].parameters[0] - f.reduced[name].parameters[2] for f in found])
        for name in "AB"
    ]
    words = "parameters that algorithm 1 removes, essential friction of joints that move"
    rows.append((words, "more in B", f"A: {removed[0]}; B: {removed[1]}", "–"))
    return Table(
        "Optimised motions and table I (with right standard deviations the last but one row is "
        "about 0.7)",
        tuple(rows),
        ("", "paper", "here, eq. 13", "standard deviations from residuals"),
    )


def median_apart(one: Found, kind: int) -> float:
    """Median distance of A from B in standard deviations from residuals (1) or of eq. 13 (2)."""
    a, b = one.values["full", "A"], one.values["full", "B"]
    return float(
        np.median([abs(a[n][0] - b[n][0]) / np.hypot(a[n][kind], b[n][kind]) for n in a if n in b])
    )


def value_cell(found: Sequence[Found], key: tuple[str, str], name: str) -> str:
    """Value of a parameter over seeds and its median standard deviations."""
    known = [f.values[key][name] for f in found if name in f.values[key]]
    if not known:
        return "–"
    every = [f.values[key][name][0] if name in f.values[key] else np.nan for f in found]
    std, noise = (float(np.median([x[k] for x in known])) for k in (1, 2))
    return f"{over_seeds(every)}; std {std:.2g}, eq. 13 {noise:.2g}"


def values_table(found: Sequence[Found]) -> Table:
    """Table I."""
    keys = (("full", "A"), ("full", "B"), ("reduced", "A"), ("reduced", "B"))
    return Table(
        "Table I: parameters by motions A and B (SI units; the paper's are of another choice of "
        "base parameters, std: median standard deviation from residuals)",
        parameter_rows(found, keys),
        ("", "true", "A", "B", "A, reduced", "B, reduced"),
    )


def reduced_table(found: Sequence[Found], name: str) -> Table:
    """Table IV."""
    return Table(
        f"Table IV: parameters by {name} (SI units; a dash: removed or not identifiable)",
        parameter_rows(found, (("full", name), ("reduced", name))),
        ("", "true", "full model", "reduced model"),
    )


def parameter_rows(
    found: Sequence[Found], keys: Sequence[tuple[str, str]]
) -> tuple[tuple[str, ...], ...]:
    """A row per parameter: true value and those of some models."""
    names = dict.fromkeys(name for f in found for key in keys for name in f.values[key])
    return tuple(
        (
            name,
            over_seeds([f.true[name] for f in found]),
            *(value_cell(found, key, name) for key in keys),
        )
        for name in names
    )


def error_table(
    found: Sequence[Found], title: str, columns: tuple[tuple[str, str], tuple[str, str]]
) -> Table:
    """Errors of models A and B, and of ours from A's log on the motion of the first."""
    ours = ("ours", columns[0][1])
    rows = tuple(
        (f"joint {k + 1}", *(printed_error(key, k) for key in columns))
        + tuple(error_cell(found, key, k) for key in (*columns, ours))
        for k in range(6)
    )
    names = ("", "paper, A", "paper, B", "its method, A", "its method, B", "ours, from A's log")
    return Table(f"{title}, eqs. 11 and 12", rows, names)


def printed_error(key: tuple[str, str], joint: int) -> str:
    """The paper's errors of a joint by eqs. 11 and 12."""
    return f"{PAPER_NM[key][joint]:.3g} Nm, {PAPER_ERRORS[key][joint]:.1f} %"


def error_cell(found: Sequence[Found], key: tuple[str, str], joint: int) -> str:
    """Errors of a joint by eqs. 11 and 12 over seeds."""
    size, share = ([f.errors[key][k, joint] for f in found] for k in (0, 1))
    return f"{over_seeds(size, 'Nm')}, {over_seeds(share, '%')}"


def reduction_table(found: Sequence[Found]) -> Table:
    """Table IV and the condition numbers, as far as numbers can carry them."""
    labels = (
        "parameters",
        "not identifiable",
        "parameters of the reduced model",
        "condition number before",
        "condition number after",
    )
    rows = []
    for name in PROCESSES:
        for k, label in enumerate(labels):
            values = [[*f.reduced[name].parameters, *f.reduced[name].conditions][k] for f in found]
            last = "all" if k == 2 else "–"
            rows.append((f"{name}: {label}", PAPER_REDUCED[name][k], over_seeds(values), last))
    rows += [
        (
            f"{name}: error of reduced ÷ full model on another motion",
            "about 1 (5 % allowed)",
            over_seeds(grown(found, name)),
            "–",
        )
        for name in PROCESSES
    ]
    for name in PROCESSES:
        for kind, what in (("kept", "kept"), ("positive", "of them positive")):
            kept = [[x for n, x in f.reduced[name].kept.items() if n in f.alone] for f in found]
            count = [len(k) if kind == "kept" else sum(x > 0.0 for x in k) for k in kept]
            label = f"{name}: inertias identifiable alone, {what}"
            rows.append((label, "all positive" if kind != "kept" else "–", over_seeds(count), "–"))
    here, ours, std, true = ([f.standing[k] for f in found] for k in range(4))
    label = f"square: viscous friction of joint 4 (true {over_seeds(true)} Nm s/rad)"
    rows.append((label, "−4340.9", over_seeds(here), over_seeds(ours)))
    rows.append(("square: standard deviation of it", "–", "–", over_seeds(std)))
    return Table("Algorithm 1, tolerance 5 % (table IV)", tuple(rows))


def drifted(one: Found, kind: str, name: str) -> dict[str, float]:
    """Values of a process model that are farther from the truth than the truth from zero."""
    return {
        parameter: value
        for parameter, (value, _, _) in one.values[kind, name].items()
        if abs(value - one.true[parameter]) > abs(one.true[parameter])
    }


def drift_text(found: Sequence[Found]) -> Text:
    """Whether algorithm 1 removes parameters that drift."""
    lines = []
    for name in PROCESSES:
        every = [drifted(f, "reduced", name) for f in found]
        full = over_seeds([float(len(drifted(f, "full", name))) for f in found])
        words = (
            f"{name.capitalize()}: farther from the truth than the truth from zero are {full} "
            f"values of the full model and {over_seeds([float(len(one)) for one in every])} of the "
            "reduced one."
        )
        far = [(abs(v - f.true[n]), k, n) for k, f in enumerate(found) for n, v in every[k].items()]
        if far:
            _, seed, worst = max(far)
            words += (
                f" Algorithm 1 does not remove all drift: of seed {seed} it keeps {worst} = "
                f"{every[seed][worst]:.3g}, where the truth is {found[seed].true[worst]:.3g}."
            )
        lines.append(words)
    name = "viscous.a4"
    kept = [f.reduced["square"].kept[name] for f in found if name in f.reduced["square"].kept]
    words = f"Square: {name}, friction of a joint that stands, is "
    words += f"kept in {len(kept)} of {len(found)} seeds" if kept else "removed in every seed"
    if kept:
        true = over_seeds([f.true[name] for f in found])
        words += f", with {over_seeds(kept)} where the truth is {true} Nm s/rad: this drift is not "
        words += "removed, as the error of joint 4 rises by more than 5 % without it"
    return Text("", (*lines, f"{words}."))


def kept_text(first: Found) -> Text:
    """Names of what is left, and of what cannot be identified."""
    lines = (
        f"First seed, {name}: left are {', '.join(one.kept)}. Not identifiable: "
        f"{', '.join(one.hidden) or 'none'}."
        for name, one in first.reduced.items()
        if name in PROCESSES
    )
    return Text("", tuple(lines))


def inertia_text(found: Sequence[Found]) -> Text:
    """In which seeds algorithm 1 keeps the inertia of joint 4 on the square, and what it costs."""
    name = "Izz.link_4"
    values = {
        k: f.reduced["square"].kept[name]
        for k, f in enumerate(found)
        if name in f.reduced["square"].kept
    }
    if not values:
        return Text("", (f"Square: algorithm 1 removes {name}, which joint 4 hardly excites.",))
    worst = max(values, key=lambda k: abs(values[k]))
    error = found[worst].errors["reduced", "square"][1, 3]
    words = (
        f"Square: algorithm 1 keeps {name}, which joint 4 hardly excites and which is near "
        f"0.04 kg m², in {len(values)} of {len(found)} seeds, with {min(values.values()):.3g} to "
        f"{max(values.values()):.3g} kg m². With the value farthest from zero (seed {worst}), the "
        f"error of joint 4 on the other square is {error:.0f} %."
    )
    return Text("", (words,))


def process_table(found: Sequence[Found], name: str) -> Table:
    """Tables V and VI."""
    rows = tuple(
        (f"joint {k + 1}", *(printed_error((m, name), k) for m in ("reduced", "A")))
        + tuple(error_cell(found, (m, name), k) for m in METHODS)
        for k in range(6)
    )
    joints = "all joints" if name != "square" else "all joints but 4"
    mean = [over_seeds([mean_error(f, m, name) for f in found], "%") for m in METHODS]
    columns = (
        "",
        "paper, reduced",
        "paper, A",
        *(f"its method, {m}" for m in ("full", "reduced", "A")),
        "ours",
    )
    title = f"Tables V and VI: another {name} motion, eqs. 11 and 12, from commanded positions"
    return Table(title, (*rows, (f"mean, {joints}", "–", "–", *mean)), columns)


def tracking_table(found: Sequence[Found]) -> Table:
    """Table VII."""
    rows: list[tuple[str, ...]] = []
    for k in range(6):
        paper = (f"{TABLE_7[name][k]:.4f}°" if name in TABLE_7 else "–" for name in TRACKED)
        here = (
            over_seeds([float(np.degrees(f.tracking[name][k])) for f in found], "°", digits=2)
            for name in TRACKED
        )
        rows += [(f"paper: joint {k + 1}", *paper), (f"joint {k + 1}", *here)]
    printed = np.array(TABLE_7["none"])
    shares = [
        f"{np.mean(np.array(TABLE_7[name]) / printed):.2f}" if name in TABLE_7 else "–"
        for name in TRACKED[1:]
    ]
    means = [over_seeds([ratios(f, name).mean() for f in found]) for name in TRACKED[1:]]
    rows += [("paper: mean ratio", "1", *shares), ("mean ratio", "1", *means)]
    columns = ("", "no model", "A", "B", "process model, reduced", "ours, process")
    return Table("Table VII: tracking errors in pick and place (RMS)", tuple(rows), columns)


PRINTED_OVERSHOOT = {
    "none": "fig. 4, no number",
    "A": "similar to the reduced model's",
    "B": "similar to the reduced model's",
    "reduced": "about half of that without a model",
}
"""What the paper says of the overshoot, by model."""


def overshoot_table(found: Sequence[Found]) -> Table:
    """Fig. 4."""
    rows = tuple(
        (
            {"none": "no model", "reduced": "process model, reduced"}.get(name, name),
            PRINTED_OVERSHOOT.get(name, "–"),
            over_seeds([1e3 * f.overshoots[name] for f in found], "mm"),
        )
        for name in TRACKED
    )
    title = "Fig. 4: mean overshoot at the corners of the square"
    return Table(title, rows, ("feedforward", "paper", "here"))


def motion_picture(first: Found) -> Picture:
    """Fig. 2."""
    panels = (
        Panel(
            "pick and place (fig. 2a)",
            "y [m]",
            "x [m]",
            (Curve("", first.places[:, 1], first.places[:, 0]),),
            square=True,
        ),
        Panel(
            "square (fig. 2b)",
            "y [m]",
            "x [m]",
            (Curve("", first.paths[0][:, 1], first.paths[0][:, 0]),),
            square=True,
        ),
    )
    return Picture("paths", "Paths of the tool from above, first seed.", panels)


def tracking_picture(found: Sequence[Found]) -> Picture:
    """Ratios of table VII, a dot per seed."""
    x = np.repeat(np.arange(6), len(found)).astype(float)
    curves = [
        Curve(
            name,
            x + 0.2 * (k - 1),
            np.array([ratios(f, key) for f in found]).T.ravel(),
            points=True,
            colour=colour,
        )
        for k, (name, key, colour) in enumerate(
            (("A", "A", 4), ("reduced", "reduced", 1), ("ours", "ours", 0))
        )
    ]
    paper = np.array(TABLE_7["reduced"]) / TABLE_7["none"]
    curves.append(Curve("paper", np.arange(6.0), paper, colour=2))
    ticks = tuple(f"joint {k}" for k in range(1, 7))
    panel = Panel("Error with ÷ without a model", "", "", tuple(curves), ticks=ticks)
    caption = "Tracking errors with feedforward over those without, one dot per seed (table VII)."
    return Picture("tracking", caption, (panel,), columns=1)


def corner_picture(first: Found) -> Picture:
    """Fig. 4."""
    names = ("desired", "no model", "process model")
    middle = first.paths[1].mean(axis=0)
    curves = tuple(
        Curve(name, 1e3 * (path[:, 1] - middle[1]), 1e3 * (path[:, 0] - middle[0]), colour=colour)
        for name, path, colour in zip(names, first.paths[1:], (4, 1, 0), strict=True)
    )
    panel = Panel("A corner of the square", "y [mm]", "x [mm]", curves, square=True)
    caption = (
        "The tool around a corner of the square, first seed (fig. 4); its deviations are "
        f"{ENLARGED:.0f} times as large as they are."
    )
    return Picture("corner", caption, (panel,), columns=1)


UR10E = """
[estimation]
method = "WLS"
effort_scales = "off"
[processing]
matched_cutoff = "off"
"""
"""The paper's method on a measured robot."""

OPTIMISED = "ur-20_02_12-40sec_12harm"
REPEATED = ("ur-19_10_01-13_51_41", "ur-19_10_01-14_04_13", "ur-19_10_01-14_04_41")
ANOTHER_DAY = "ur-19_09_27-15_11_06"
"""Logs of the UR10e: an optimised motion; one motion of 5 s three times, and on another day."""


@dataclass(frozen=True)
class OnRobot:
    """What was found from one motion of the UR10e.

    Attributes:
        name: The motion.
        reduced: What algorithm 1 did.
        errors: On the same kind of motion, not fitted, by method.
        fitted: On the fitted motion, likewise.
    """

    name: str
    reduced: Reduced
    errors: dict[str, Errors]
    fitted: dict[str, Errors]

    def over(self, one: str, other: str, fitted: bool = False) -> float:
        """Mean absolute error of one method over that of another, mean of the joints."""
        found = self.fitted if fitted else self.errors
        return float(np.mean(found[one].absolute) / np.mean(found[other].absolute))

    def greatest_rise(self) -> float:
        """Greatest rise of a joint's mean absolute error by the reduction, unseen motion [%]."""
        rises = np.divide(self.errors["reduced"].absolute, self.errors["full"].absolute)
        return float(100.0 * rises.max() - 100.0)

    @property
    def fall(self) -> float:
        """Condition number of the full model over that of the reduced one."""
        before, after = self.reduced.conditions
        return before / after


def measured(folder: Path, quick: bool) -> Section:
    """Algorithm 1 on motions that a UR10e repeats."""
    way = log(UR10E_PROCESS)
    paper, ours = (
        example("ur10e", folder / f"{name}.toml", tables)
        for name, tables in (("paper", UR10E), ("ours", ""))
    )
    identify = partial(steelyard.identify, check=False, threads=1)
    optimised = identify(paper, ur10e(OPTIMISED)).model
    motions: dict[str, tuple[list[str], str]] = {
        "point to point": ([way + "#700:2450"], way + "#2450:4200"),
        "one motion of 5 s": (ur10e(*REPEATED), ur10e(ANOTHER_DAY)[0]),
    }
    found = []
    for name, (logs, unseen) in list(motions.items())[: 1 if quick else None]:
        full = identify(paper, logs).model
        smaller = steelyard.reduce(
            full,
            logs,
            criterion="mean_column",
            stop="tolerance=5",
            error="mean_absolute",
            essential="none",
            threads=1,
        )
        models = {
            "full": full,
            "reduced": smaller.model,
            "A": optimised,
            "ours": identify(ours, logs).model,
        }
        unseen_errors, fitted = (errors_on(models, some, like="ours") for some in (unseen, logs[0]))
        found.append(OnRobot(name, summary(smaller), unseen_errors, fitted))
    tables = (
        percent_table(f"UR10e, {one.name}: error on unseen motion", one.errors) for one in found
    )
    text = Text(HEADING, ON_ROBOT)
    return Section((text, robot_verdicts(found), robot_table(found), *tables), robot_claims(found))


ON_ROBOT = (
    "UR10e, motor currents times published gains. As a process it moves from point to point "
    "through ten postures, with rests; the first half of the log is fitted, the second half is "
    "unseen. And it runs one motion of 5 s three times, which is fitted; unseen is the same motion "
    "on another day. Model A is from an optimised motion of 40 s.",
    "The paper's method: weighted least squares, no filter of the regressor, order by the mean "
    "column (eq. 10), tolerance of 5 % of the mean absolute error of each joint on the fitted "
    "motion (eqs. 11 and 12), E empty. Different from the paper: the weights are of the joints, as "
    "the logs have too few repetitions for a variance of each time step, and samples at "
    "standstill, whose currents friction determines, are left out. Ours has its defaults. All "
    "models are compared on the same signals, those of ours, where joints move.",
)


def robot_verdicts(found: Sequence[OnRobot]) -> Table:
    """The paper's claims on the UR10e."""

    def each(values: Sequence[float]) -> str:
        return "; ".join(f"{one.name} {x:.3g}" for one, x in zip(found, values, strict=True))

    def holds(true: Sequence[bool]) -> str:
        return "yes" if all(true) else "partly" if any(true) else "no"

    falls = [one.fall for one in found]
    rows = [
        (
            "reduction divides the condition number by ten or so",
            each(falls),
            ">= 5",
            holds([x >= 5.0 for x in falls]),
        )
    ]
    for one, other, words in (
        ("reduced", "full", "reduced ÷ full model, error on unseen motion of the same kind"),
        ("reduced", "A", "reduced ÷ model A, error on unseen motion of the process"),
    ):
        ratios_here = [which.over(one, other) for which in found]
        rows.append((words, each(ratios_here), "<= 1.05", holds([x <= 1.05 for x in ratios_here])))
    rises = [one.greatest_rise() for one in found]
    rows.append(
        (
            "no joint's error rises by more than the tolerance on unseen motion: greatest rise [%]",
            each(rises),
            "<= 5",
            holds([x <= 5.0 for x in rises]),
        )
    )
    columns = ("the paper", "figure", "bound", "holds there")
    return Table(
        "What the paper claims, and whether it holds on a measured robot", tuple(rows), columns
    )


def robot_table(found: Sequence[OnRobot]) -> Table:
    """Sizes, condition numbers and mean absolute errors."""
    rows: list[tuple[str, ...]] = []
    for one in found:
        every, _, kept = one.reduced.parameters
        before, after = one.reduced.conditions
        rows += [
            (f"{one.name}: parameters, full and reduced", f"{every}", f"{kept}", "–", "–"),
            (f"{one.name}: condition number", f"{before:.3g}", f"{after:.3g}", "–", "–"),
        ]
        for words, errors_here in (("fitted", one.fitted), ("unseen", one.errors)):
            means = (f"{np.mean(errors_here[name].absolute):.3g}" for name in METHODS)
            rows.append((f"{one.name}: mean absolute error, {words} [Nm]", *means))
    return Table("Reduction on the UR10e, mean of six joints", tuple(rows), ("", *METHODS))


def robot_claims(found: Sequence[OnRobot]) -> tuple[Claim, ...]:
    """Bounds of the UR10e."""
    return tuple(
        Claim(
            f"measured UR10e, {one.name}: reduced ÷ full model, error on unseen motion",
            f"{one.over('reduced', 'full'):.3g}",
            "<= 1.05",
            one.over("reduced", "full") <= 1.05,
        )
        for one in found
    )


STUDY = Study("p2", one, page, measured)

if __name__ == "__main__":
    run(STUDY)
