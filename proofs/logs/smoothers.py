"""Kalman smoother, projection on harmonics, smoothing spline and Butterworth against the truth.

Five motions of the virtual demo arm, with friction and a controller that sags: periodic and logged
in mid-motion; a Fourier series that does not repeat; point to point with rests; sinusoids of single
joints; a chirp. Errors are root mean squares over joints and time, after the whole chain as
`prepare` runs it, with every method's own defaults. The default must lie within 20 % of the best of
the four for positions, velocities and accelerations alike.
"""

from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.base.motion import Trajectory
from steelyard.excite.constraints.constraint_and_limits import motion_limits
from steelyard.excite.trajectories.exact_trajectories import SampledMotion
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import Signals
from steelyard.robot.robot import Robot
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.smoothing.kalman_smoother import Kalman
from steelyard.runs.smoothing.likeliest_cutoffs_and_fourier import Fourier
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import Butterworth, Method
from steelyard.runs.smoothing.spline_and_finite_windows import SmoothingSpline
from steelyard.simulate.drives_sensors_and_loads import Sensors, TrueRun
from steelyard.simulate.ground_truth import random_truth
from steelyard.simulate.virtual_robot import VirtualRobot, customary_sensors

METHODS: tuple[Method, ...] = (Kalman(), Fourier(), SmoothingSpline(), Butterworth())
WITHIN = 1.2
NOISY = 1e-4
"""White noise of noisy encoders [rad]."""
STEP = 0.004
"""Step of the tables that motions are given as [s]."""


@dataclass(frozen=True, eq=False)
class Case:
    """A motion that was run.

    Attributes:
        name: What it is.
        run: What happened.
        window: Start and end of the log, in seconds of the run.
        inside: Seconds of the log whose errors count.
    """

    name: str
    run: TrueRun
    window: tuple[float, float]
    inside: tuple[float, float]


def demo_arm() -> Robot:
    """Six joints."""
    return load_robot(Path(str(files("steelyard.simulate") / "demo_arm.urdf"))).robot


def minimum_jerk(share: Array) -> Array:
    """From 0 to 1 with rest at both ends."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def point_to_point(robot: Robot, rng: np.random.Generator) -> SampledMotion:
    """Ten moves with a second of rest after each."""
    limits = motion_limits(robot)
    middle, half = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
    points = middle + 0.4 * half * rng.uniform(-1.0, 1.0, (11, robot.n))
    steps = np.diff(points, axis=0)
    move = max(
        float((np.abs(steps) * 1.875 / limits.velocity).max()) / 0.8,
        float(np.sqrt((np.abs(steps) * 5.8 / limits.acceleration).max() / 0.8)),
    )
    t = np.arange(0.0, 10.0 * (move + 1.0), STEP)
    q = points[0] + sum(
        np.outer(minimum_jerk((t - k * (move + 1.0)) / move), step) for k, step in enumerate(steps)
    )
    return SampledMotion(t, q)


def single_joints(robot: Robot, frequency: float = 0.5, cycles: int = 5) -> SampledMotion:
    """One joint after the other swings up and down again."""
    limits = motion_limits(robot)
    half = 0.5 * (limits.upper - limits.lower)
    size = np.minimum(0.4 * half, 0.5 * limits.velocity / (2.0 * np.pi * frequency))
    each = cycles / frequency
    t = np.arange(0.0, each * robot.n, STEP)
    since = np.mod(t, each)
    swing = 0.5 * (1.0 - np.cos(2.0 * np.pi * since / each))
    swing = swing * np.sin(2.0 * np.pi * frequency * since)
    turn = np.eye(robot.n)[np.minimum((t // each).astype(int), robot.n - 1)]
    return SampledMotion(t, 0.5 * (limits.lower + limits.upper) + turn * size * swing[:, None])


def chirp(robot: Robot, rng: np.random.Generator, duration: float = 30.0) -> SampledMotion:
    """All joints from 0.1 to 2 Hz, slower ones wider."""
    limits = motion_limits(robot)
    half = 0.5 * (limits.upper - limits.lower)
    fast = np.minimum(
        limits.velocity / (0.2 * np.pi), limits.acceleration / (0.2 * (2.0 * np.pi) ** 2)
    )
    t = np.arange(0.0, duration, STEP)
    share = t / duration
    frequency = 0.1 + 1.9 * share
    phase = 2.0 * np.pi * (0.1 * t + 0.95 * t * share)
    size = minimum_jerk(10.0 * np.minimum(share, 1.0 - share)) * 0.1 / frequency
    wave = size[:, None] * np.sin(phase[:, None] + rng.uniform(0.0, 6.0, robot.n))
    middle = 0.5 * (limits.lower + limits.upper)
    return SampledMotion(t, middle + np.minimum(0.4 * half, 0.6 * fast) * wave)


def cases(robot: Robot) -> tuple[list[Case], Sensors]:
    """The five motions, and the sensors."""
    truth, rng = random_truth(robot, 3), np.random.default_rng(5)
    motions: dict[str, Trajectory] = {
        "periodic": random_fourier(robot, seed=1, period=5.0, periods=8),
        "not repeating": random_fourier(robot, seed=2, period=40.0, harmonics=20),
        "point to point": point_to_point(robot, rng),
        "single joints": single_joints(robot),
        "chirp": chirp(robot, rng),
    }
    made = []
    for name, motion in motions.items():
        run = VirtualRobot(robot, truth).follow(motion)
        end = float(run.t[-1])
        cut = (6.0, 35.0) if name == "periodic" else (0.0, end)
        inside = (0.5, cut[1] - cut[0] - 0.5) if name == "periodic" else (1.0, end - 1.0)
        made.append(Case(name, run, cut, inside))
    return made, customary_sensors(robot, truth)


def logged(case: Case, robot: Robot, sensors: Sensors, noise: float) -> tuple[Recording, float]:
    """The log of a motion, without velocities, and the true time of its first row."""
    quiet = Sensors(
        rate=sensors.rate,
        resolution=sensors.resolution,
        position_noise=noise,
        torque_noise=sensors.torque_noise,
        clock_jitter=sensors.clock_jitter,
    )
    reading = quiet.measure(case.run, np.random.default_rng(0))
    rows = (reading.t >= case.window[0] - 1e-3) & (reading.t <= case.window[1] + 1e-3)
    names = tuple(f"{kind}{j}" for kind in "qe" for j in range(robot.n))
    ones = np.ones(robot.n)
    signals = Signals(
        time="t",
        time_scale=1.0,
        position=names[: robot.n],
        position_scale=ones,
        velocity=None,
        velocity_scale=None,
        effort=names[robot.n :],
        effort_scale=ones,
        effort_kind="joint_torque",
        effort_units=robot.effort_units,
        gains=ones,
    )
    table = np.column_stack((reading.t, reading.q, reading.effort))[rows]
    log = LogInMemory(Path(case.name), ("t", *names), table)
    return Recording(log, signals), float(table[0, 0])


def errors(case: Case, recording: Recording, origin: float, wanted: Processing) -> Array | None:
    """Root mean square errors of q, dq and ddq; `None` where the method refuses the log."""
    try:
        motion = prepare(recording, wanted).whole().motion
    except LogError:
        return None
    run = case.run
    true = run.q, run.dq, np.gradient(run.dq, run.t, axis=0)
    inside = (motion.t >= case.inside[0]) & (motion.t <= case.inside[1])
    at = motion.t[inside] + origin
    found = motion.q[inside], motion.dq[inside], motion.ddq[inside]
    apart = [
        np.column_stack([np.interp(at, run.t, column) for column in x.T]) - y
        for x, y in zip(true, found, strict=True)
    ]
    return np.array([np.sqrt(np.square(x).mean()) for x in apart])


def main() -> list[Claim]:
    """Five motions, with good and with noisy encoders."""
    robot = demo_arm()
    made, sensors = cases(robot)
    claims = []
    for words, noise in (("encoders of 17 bits", 0.0), ("encoders with 0.1 mrad of noise", NOISY)):
        for case in made:
            recording, origin = logged(case, robot, sensors, noise)
            plain = Processing()
            ours = errors(case, recording, origin, plain)
            theirs = {
                m.name: errors(case, recording, origin, replace(plain, motion=m)) for m in METHODS
            }
            known = {name: e for name, e in theirs.items() if e is not None}
            for name, e in {"default": ours, **theirs}.items():
                figure = "refused" if e is None else " ".join(f"{x:.3g}" for x in e)
                claims.append(Claim(f"  {case.name}, {name}", figure, "q, dq, ddq", True))
            best = np.min(list(known.values()), axis=0)
            ratio = np.inf if ours is None else float((ours / best).max())
            claims.append(
                Claim(
                    f"{case.name}, {words}: default over the best, worst of q, dq, ddq",
                    f"{ratio:.2f}",
                    f"<= {WITHIN}",
                    ratio <= WITHIN,
                )
            )
    return claims


if __name__ == "__main__":
    main_of(main)
