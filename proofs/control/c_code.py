"""Exported C code against Python: every law, trees, closed chains, real arms, the papers' robots.

Errors are relative to one plus the value's size, in single precision to one plus the largest effort
of the sample, as efforts in which large ones cancel have fewer digits. States are rest at zero,
rest at half turns, and random ones; laws with memory go along consecutive samples. The code is
compiled by gcc as C99 without warnings, its self-tests run as C++ and under the address and
undefined-behaviour sanitizers, and its object files are searched for symbols beside those of the
mathematical library.
"""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, data_folder, main_of

import steelyard
from steelyard.base.arrays import Array, Parameters
from steelyard.base.motion import Motion
from steelyard.export.code.c_code import CCode
from steelyard.export.code.controller_functions import FUNCTIONS, Controller, ObserverNumbers
from steelyard.export.code.export_code import end_frames
from steelyard.model.equations.passive_joints import passive_positions, random_positions
from steelyard.model.laws.friction_over_speed import (
    DirectionalCoulomb,
    DirectionalViscous,
    Stribeck,
    Viscous,
)
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.laws.laws_without_friction import RigidBody, Spring
from steelyard.model.laws.register import DEFAULT_TERMS
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.robot.file.model_reading_and_loaded_robot import dh_mechanism
from steelyard.robot.file.sections import DHRow
from steelyard.robot.robot import Limits, Robot
from steelyard.robot.robot_from_mechanism import reduced
from steelyard.symbolic.source_code import Precision

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from closed_chains import CHAINS, parallelogram  # noqa: E402
from export import test_controller_observer as observed  # noqa: E402
from in_c import (  # noqa: E402
    LIBM,
    STRICT,
    Library,
    apart,
    apart_in_sample,
    code_of,
    compiler,
    run_compiler,
    self_tested,
    written,
)
from invented import ball, tree  # noqa: E402
from law_cases import CASES  # noqa: E402
from moving import cycles, geared  # noqa: E402

STATES, SAMPLES = 1000, 10_000
DAMPING = 0.05
"""Bristles of 3e-4 rad that carry 1 Nm and move 1 kg m² are critically damped by 0.035 per unit of
their rate; single precision resolves that rate, a difference of large numbers, less well."""
BOUNDS: dict[Precision, float] = {"double": 1e-12, "float": 1e-5}
FILES = {
    "UR10e": "examples/ur10e.toml",
    "Panda": "examples/panda.toml",
    "Rokae AR5": "examples/rokae_ar5.toml",
    "TIAGo": "examples/tiago.toml",
    "TX40": "examples/tx40.toml",
    "leg (p1)": "studies/robots/p1_leg.toml",
    "welder (p2)": "studies/robots/p2_arm.toml",
    "7R arm (p4)": "studies/robots/p4_arm.toml",
}


def rx160() -> tuple[Robot, tuple[Term, ...]]:
    """The arm of p3, its lengths from the data sheet: spring, Stribeck friction, coupled wrist."""
    quarter = 0.5 * np.pi
    rows = [
        DHRow(a=0.15, alpha=-quarter, d=0.55),
        DHRow(a=0.825, theta=-quarter),
        DHRow(alpha=quarter, theta=quarter),
        DHRow(alpha=-quarter, d=0.625),
        DHRow(alpha=quarter),
        DHRow(d=0.11),
    ]
    robot = reduced(dh_mechanism(rows, "standard", "rx160"))[0]
    first, second, *_, fifth, sixth = robot.joint_names
    wrist = (("wrist", ((fifth, 1.0), (sixth, 1.0))),)
    own = tuple(x for x in DEFAULT_TERMS if x.law not in ("coulomb", "viscous"))
    return robot, (
        *own,
        Viscous(),
        Stribeck(smoothing=0.02),
        Viscous(along=wrist),
        Spring(joints=second),
    )


def parallel_arm() -> Robot:
    """The arm of p5, away from where its bars lie in one line and loops could cross over."""
    robot = parallelogram(tuple(ball(k) for k in range(4)), 0.3, 0.4)
    ranges = Limits(-0.4, 0.4), Limits(1.1, 1.9)
    moved = zip(robot.coordinates, ranges, strict=True)
    return robot.changed(coordinates=tuple(replace(c, limits=x) for c, x in moved))


def robots() -> Iterator[tuple[str, Robot, tuple[Term, ...]]]:
    """Robots with their terms."""
    yield "tree", tree(), DEFAULT_TERMS
    for name, make in CHAINS.items():
        yield name, make(), DEFAULT_TERMS
    for name, file in FILES.items():
        model = steelyard.model_of(ROOT / file)
        yield name, model.robot, model.terms
    yield "RX160 (p3)", *rx160()
    directional = (RigidBody(), DirectionalCoulomb(), DirectionalViscous())
    yield "parallel arm (p5)", parallel_arm(), directional


def controller_of(robot: Robot, terms: tuple[Term, ...], names: tuple[str, ...]) -> Controller:
    """Physically consistent bodies, and invented values of other parameters."""
    model, rng = Model(robot, terms), np.random.default_rng(0)
    bodies = [
        np.zeros(10) if body.massless else (body.inertia if body.inertia.mass else ball(k)).ten
        for k, body in enumerate(robot.bodies)
    ]
    values = {n: float(rng.uniform(0.1, 1.0)) for n in model.names}
    for name in (n for n in model.names if n.startswith("lugre_damping")):
        values[name] *= DAMPING
    tens = RigidBody().parameters(robot)
    values |= {p.name: float(x) for p, x in zip(tens, np.ravel(bodies), strict=True)}
    known = Parameters(model.names, model.units, [values[n] for n in model.names])
    return Controller(model, known, names, end_frames(robot)[-1:])


def motion_of(robot: Robot, count: int = STATES) -> tuple[Motion, Array]:
    """States, in single precision where there is no loop, and positions of passive joints."""
    rng = np.random.default_rng(7)
    q = random_positions(robot, count, rng)[0].T.copy()
    dq, ddq = rng.normal(size=(2, *q.shape)) * np.array([1.0, 3.0])[:, None, None]
    if not robot.passive:
        q[0], q[1], q[2] = 0.0, np.pi, -np.pi
        q = q.astype(np.float32).astype(np.float64)
    dq[:3] = ddq[:3] = 0.0
    dq, ddq = (x.astype(np.float32).astype(np.float64) for x in (dq, ddq))
    return Motion(np.arange(count), q, dq, ddq), passive_positions(robot, q.T).T


def wander(robot: Robot, count: int = SAMPLES) -> Motion:
    """Consecutive samples that begin at some speed and reverse often."""
    q, dq, ddq = (0.05 * x.T.astype(np.float32) for x in cycles(robot.n, 5, count // 5))
    return Motion(np.arange(count) / 1000.0, q + robot.assembly[: robot.n], dq, ddq)


def along(library: Library, name: str, arrays: list[Array], sizes: list[int]) -> Array:
    """Results of a function at samples, shape `(N, entries)`."""
    return np.array([library.call(name, list(row), sizes) for row in zip(*arrays, strict=True)])


def law_claims(folder: Path, precision: Precision) -> list[Claim]:
    """Every law on a robot with gears and a prismatic joint."""
    robot = geared()
    controllers = {
        f"law_{k}": controller_of(
            robot.changed(name=f"law_{k}"),
            (term,) if (term := case.on(robot)).role == "body" else (RigidBody(), term),
            ("torque",),
        )
        for k, case in enumerate(CASES)
    }
    sources = [written(code_of(c, precision), folder) for c in controllers.values()]
    library = Library(sources, folder, precision)
    errors: dict[str, list[float]] = {"static": [], "memory": []}
    for name, controller in controllers.items():
        model = controller.model.at(controller.values)
        if controller.n_memory:
            motion = wander(robot)
            found = library.along(name, controller.n_memory, motion.q, motion.dq, motion.ddq)
        else:
            motion, _ = motion_of(robot)
            found = along(library, f"{name}_torque", [motion.q, motion.dq, motion.ddq], [robot.n])
        error = apart if precision == "double" else apart_in_sample
        kind = "memory" if controller.n_memory else "static"
        errors[kind].append(error(found, model.torque(motion)))
    claims = []
    for kind, found in errors.items():
        bound = BOUNDS[precision]
        size = f"{STATES} states" if kind == "static" else f"{SAMPLES} samples"
        what = f"{precision}: {len(found)} cases of {kind} laws, {size}"
        claims.append(Claim(what, f"{max(found):.1e}", f"<= {bound:g}", max(found) <= bound))
    return claims


def robot_claims(folder: Path) -> list[Claim]:
    """All functions on all robots."""
    claims = []
    for name, robot, terms in robots():
        static = tuple(t for t in terms if not hasattr(t, "n_memory"))
        controller = controller_of(robot, static, tuple(FUNCTIONS))
        error, conditioned, single = errors_of(controller, folder / name.replace(" ", "_"))
        claims += [
            Claim(
                f"{name}: functions, {STATES} states", f"{error:.1e}", "<= 1e-12", error <= 1e-12
            ),
            Claim(
                f"{name}: forward dynamics after torque, and regressor times values",
                f"{conditioned:.1e}",
                "<= 1e-9",
                conditioned <= 1e-9,
            ),
            Claim(f"{name}: torque in float", f"{single:.1e}", "<= 1e-5", single <= 1e-5),
        ]
    return claims


def errors_of(controller: Controller, folder: Path) -> tuple[float, float, float]:
    """Of the quantities, of what needs division by the mass matrix, and of the torque in float."""
    robot, frame = controller.model.robot, controller.frames[0]
    model = controller.model.at(controller.values)
    motion, passive = motion_of(robot)
    q, dq, ddq = motion.q, motion.dq, motion.ddq
    code = code_of(controller)
    library = Library([written(code, folder)], folder, "double")
    closed = [passive] if robot.passive else []
    position, rotation = model.pose(q, frame)
    torque = model.torque(motion)
    wanted = {
        "torque": ([dq, ddq], torque),
        "gravity": ([], model.gravity(q)),
        "bias": ([dq], model.bias(q, dq)),
        "friction": ([dq], model.friction(motion)),
        "mass": ([], model.mass_matrix(q)),
        "momentum": ([dq], model.momentum(q, dq)),
        "momentum_rate": ([dq], model.momentum_rate(q, dq)),
        "pose": ([], np.concatenate([position, rotation.reshape(-1, 9)], axis=1)),
        "jacobian": ([], model.jacobian(q, frame)),
    }
    errors = []
    for function, (arguments, value) in wanted.items():
        sizes = [size for _, size in code.functions[function][0].sizes]
        found = along(library, f"{code.name}_{function}", [q, *closed, *arguments], sizes)
        errors.append(apart(found, value.reshape(len(q), -1)))
    n, b = robot.n, len(controller.parameters)
    values = library.call(f"{code.name}_parameters", [], [b])
    columns = along(library, f"{code.name}_regressor", [q, *closed, dq, ddq], [n * b])
    back = along(library, f"{code.name}_forward_dynamics", [q, *closed, dq, torque], [n + 1])
    conditioned = [apart(columns.reshape(-1, n, b) @ values, torque), apart(back[:, :n], ddq)]
    short = replace(controller, names=("torque",))
    source = written(code_of(short, "float"), folder / "float")
    single = Library([source], folder, "float")
    found = along(single, f"{code.name}_torque", [q, *closed, dq, ddq], [n])
    return max(errors), max(conditioned), apart_in_sample(found, torque)


def closing_claim(folder: Path) -> Claim:
    """Friction with memory on a closed chain that C follows by itself."""
    robot = CHAINS["five-bar"]()
    terms = (*DEFAULT_TERMS, Dahl(length=2e-3))
    controller = controller_of(robot, terms, ())
    library = Library([written(code_of(controller), folder)], folder, "double")
    motion = wander(robot)
    size = len(robot.passive) + controller.n_memory
    found = library.along("five_bar", size, motion.q, motion.dq, motion.ddq)
    error = apart(found, controller.model.at(controller.values).torque(motion))
    what = f"five-bar with presliding, followed by the code, {SAMPLES} samples"
    return Claim(what, f"{error:.1e}", "<= 1e-12", error <= 1e-12)


def observer_claim(folder: Path) -> Claim:
    """External efforts on a tree, with gears and memory, and on a closed chain that C follows."""
    folder.mkdir()
    worst, alike = 0.0, True
    for name in observed.CASES:
        model = observed.model_of(name)
        given = observed.samples(model.robot, SAMPLES)
        efforts, contact = observed.in_python(model, given)
        code = CCode(observed.controller(model), "double", ("From a proof.",))
        found, joints, _ = observed.in_c(code, folder / name, "double", given)
        worst = max(worst, apart(found, efforts))
        alike = alike and bool(np.array_equal(joints, contact))
    what = f"observer of {len(observed.CASES)} robots, {SAMPLES} samples; contact alike: {alike}"
    return Claim(what, f"{worst:.1e}", "<= 1e-12", worst <= 1e-12 and alike)


def compiler_claims(folder: Path) -> list[Claim]:
    """Warnings, C++, sanitizers, symbols."""
    clean, symbols, count = 0, set[str](), 0
    sanitizers = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    for name, robot, terms in robots():
        controller = controller_of(robot, (*terms, Dahl(length=2e-3)), tuple(FUNCTIONS))
        controller = replace(controller, observer=ObserverNumbers(8.0, None))
        for precision in BOUNDS:
            place = folder / f"{name}_{precision}".replace(" ", "_")
            code = code_of(controller, precision)
            source = written(code, place)
            run_compiler(compiler(), "-std=c99", "-O2", *STRICT, "-c", source, "-o", place / "a.o")
            lines = subprocess.run(
                ["nm", "-P", str(place / "a.o")], capture_output=True, text=True, check=True
            ).stdout.splitlines()
            symbols |= {line.split()[0] for line in lines if line.split()[1] == "U"}
            for command in (
                (compiler("g++"), "-x", "c++", "-std=c++11", *STRICT),
                (compiler(), "-std=c99", *STRICT, *sanitizers),
            ):
                done = self_tested(code, source, *command)
                clean += done.returncode == 0 and not done.stderr
                count += 1
    known = LIBM | {f"{name}f" for name in LIBM}
    return [
        Claim(f"self-tests, {' '.join(STRICT)}, C++ and sanitizers", f"{clean} of {count}", "all",
              clean == count),
        Claim("symbols outside the code", " ".join(sorted(symbols)), "libm only", symbols <= known),
    ]  # fmt: skip


def main() -> list[Claim]:
    """Everything; about five minutes."""
    data_folder()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        return [
            *law_claims(place / "double", "double"),
            *law_claims(place / "float", "float"),
            *robot_claims(place / "robots"),
            closing_claim(place / "closing"),
            observer_claim(place / "observer"),
            *compiler_claims(place / "compilers"),
        ]


if __name__ == "__main__":
    main_of(main)
