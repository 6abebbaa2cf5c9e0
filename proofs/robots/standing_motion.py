"""A designed motion on four feet, played by an A1 with other bodies: it stands, and shows more.

The motion is designed for the model file. The simulated robot, whose bodies are 15 % and 1 cm off,
follows it by position control with the planned torques ahead; its feet must stay and push, and the
zero-moment point stay inside the support polygon. Logs of it, of a random motion within the same
limits and of sways of single joints, all of the same duration, are compared by the intervals of
fits, with forces of the feet and without.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from proofs.support.claims import Claim, data_folder, main_of
from proofs.support.legged_robots import LEGGED, STEP, Simulation, Targets
from proofs.support.legged_trials import Trial, covered, intervals
from scipy.spatial import ConvexHull

import steelyard
from steelyard.base.arrays import Array
from steelyard.excite.design_problem_from_tables import build
from steelyard.excite.excite import design_task
from steelyard.excite.search.feasibility import each_start
from steelyard.excite.standing.forces_of_feet import FeetForces
from steelyard.excite.standing.legs_follow_base import Legs
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.robot.inertia_and_placement import rpy_rotation
from steelyard.robot.robot import Robot

SECONDS, BUDGET = 10.0, 120.0  # of the motions, and of the design [s]
LEGS = [f"{leg}_{k}_joint" for leg in ("FR", "FL", "RR", "RL") for k in ("hip", "thigh", "calf")]
FASTEST = {
    "velocity": {"x": 0.6, "r": 3.0, "leg": 5.0},
    "acceleration": {"x": 1.5, "r": 6.0, "leg": 12.0},
}
STIFFNESS = 100.0  # of the position control [Nm/rad]
BALL = 0.02  # radius of the feet [m]
MOST_SLIP = 0.02  # way that the point of a foot that touches slides on the floor, at most [m]
MOST_UNLOADED = 0.5  # share of samples in which a foot bears less than 1 N, at most [%]
LEAST_INSIDE = 0.02  # distance of the zero-moment point from the support polygon's edges [m]
GAIN, BESIDE_SWAYS = 0.3, 0.8
"""Geometric means of half-widths, at most: over those of a random motion, and of sways whose forces
are measured."""
LEAST = 90.0  # share of intervals that hold the truth, forces measured, at least [%]


def stance() -> str:
    """The tables of the design."""
    limits = []
    for quantity, most in FASTEST.items():
        each = [f"base_{axis} = {most['x']}" for axis in "xyz"]
        each += [f"base_r{axis} = {most['r']}" for axis in "xyz"]
        each += [f"{joint} = {most['leg']}" for joint in LEGS]
        limits.append(f"{quantity} = {{{', '.join(each)}}}")
    return f"""
[excitation.motion]
kind = "fourier"
period = {SECONDS}
harmonics = 10
[excitation.stance]
feet = ["FR_calf", "FL_calf", "RR_calf", "RL_calf"]
points = [[0.0, 0.0, -0.2]]
radius = {BALL}
posture = [{", ".join(["0.0, 0.9, -1.8"] * 4)}]
friction = 0.25
least_load = 0.5
[excitation.limits]
{chr(10).join(limits)}
"""


@dataclass(frozen=True, eq=False)
class Plan:
    """A motion of all joints, the forces of its feet, and the robot that it is of."""

    motion: ExactTrajectory
    forces: FeetForces
    robot: Robot

    def targets(self, joints: list[str]) -> Targets:
        """Positions of joints and the planned torque over the stiffness, in their order."""
        t = np.linspace(0.0, self.motion.duration, int(500 * self.motion.duration) + 1)
        q, dq, ddq = (self.motion.derivative(t, order) for order in range(3))
        efforts = self.forces.columns(q, dq, ddq)
        columns = [self.robot.joint_names.index(name) for name in joints]
        torque = np.column_stack([efforts[f"tau_{name}"] for name in joints])
        ahead = q[:, columns] + torque / STIFFNESS
        return lambda at: np.array([np.interp(at, t, one) for one in ahead.T])


class Played(Simulation):
    """The robot that follows a plan, sways if there is none; what its feet do is kept."""

    plan: Plan | None = None

    def follow(self, plan: Plan) -> None:
        """Begin where the plan does."""
        self.plan = plan
        at = plan.motion.derivative([0.0], 0)[0]
        height = -float(plan.forces.places[0, 2])
        self.data.qpos[:3] = at[:3] + [0.0, 0.0, height]
        mujoco.mju_mat2Quat(self.data.qpos[3:7], rpy_rotation(*at[3:6]).ravel())
        self.data.qpos[7:] = [at[plan.robot.joint_names.index(name)] for name in self.joints]

    def _targets(self, seed: int, trot: float) -> Targets:
        self.slip, self.loads, self.inside = np.zeros(4), list[Array](), list[float]()
        return super()._targets(seed, trot) if self.plan is None else self.plan.targets(self.joints)

    def _reading(self) -> Array:
        model, data, load = self.model, self.data, np.zeros(4)
        places = np.array([data.xpos[model.body(foot).id] for foot in self.robot.feet])
        numbers = [model.body(foot).id for foot in self.robot.feet]
        for k in range(data.ncon):
            contact, six = data.contact[k], np.zeros(6)
            feet = {int(model.geom_bodyid[g]) for g in contact.geom} & set(numbers)
            for foot in (numbers.index(body) for body in feet):
                mujoco.mj_contactForce(model, data, k, six)
                load[foot] += six[0]  # the floor is horizontal
                places[foot] = contact.pos
                kind = mujoco.mjtObj.mjOBJ_XBODY
                mujoco.mj_objectVelocity(model, data, kind, numbers[foot], six, 0)
                arm = contact.pos - data.xpos[numbers[foot]]
                self.slip[foot] += STEP * np.hypot(*(six[3:] + np.cross(six[:3], arm))[:2])
        edges = ConvexHull(places[:, :2]).equations
        point = load @ places[:, :2] / max(load.sum(), 1e-9)
        self.inside.append(-float((edges[:, :2] @ point + edges[:, 2]).max()))
        self.loads.append(load)
        return super()._reading()


def played(folder: Path, name: str, plan: Plan | None) -> tuple[Trial, Played]:
    """One log, and its robot files."""
    robot = LEGGED["A1"]
    path = data_folder().parent / "models" / robot.file
    simulation = Played(path, robot, 0)
    if plan is not None:
        simulation.follow(plan)
    log = folder / f"{name}.parquet"
    simulation.log(log, SECONDS, 0)
    flags = simulation.robot_file(folder, path, measured=False)
    return Trial(simulation, [log], simulation.robot_file(folder, path), flags), simulation


def plans(folder: Path) -> dict[str, Plan | None]:
    """The designed motion, a random one, and sways."""
    robot = LEGGED["A1"]
    path = data_folder().parent / "models" / robot.file
    file = Simulation(path, robot, 0).robot_file(folder, path, stance(), measured=False)
    designed = steelyard.design_excitation(file, budget=BUDGET, processes=1).designed
    if not designed.certificate.holds:
        raise AssertionError(f"not proven: {designed.certificate.failures}")
    print(next(note for note in designed.notes if "zero-moment" in note))
    (forces,) = (one for one in designed.constraints if isinstance(one, FeetForces))
    problem = build(*design_task(file).tables)
    start = next(each_start(problem.inequalities, np.random.default_rng(0), 1))
    print(f"criterion {designed.shown.criterion_value:.3g}", end=", ")
    print(f"of the random motion {problem.criterion_value(start):.3g}")
    motion = Legs(problem.robot).motion(problem.basis.motion(start))
    return {
        "designed": Plan(designed.trajectory, forces, designed.robot),
        "random": Plan(motion, forces, designed.robot),
        "sways": None,
    }


def of_play(simulation: Played) -> list[Claim]:
    """What the feet did."""
    slip, inside = float(simulation.slip.max()), min(simulation.inside)
    unloaded = 100.0 * float(np.mean(np.array(simulation.loads) < 1.0))
    return [
        Claim(
            "zero-moment point inside the support polygon",
            f"{1e3 * inside:.0f} mm",
            f">= {1e3 * LEAST_INSIDE:g} mm",
            inside >= LEAST_INSIDE,
        ),
        Claim(
            "way that a foot slides in all",
            f"{1e3 * slip:.1f} mm",
            f"<= {1e3 * MOST_SLIP:g} mm",
            slip <= MOST_SLIP,
        ),
        Claim(
            "samples with a foot that bears less than 1 N",
            f"{unloaded:.2f} %",
            f"<= {MOST_UNLOADED:g} %",
            unloaded <= MOST_UNLOADED,
        ),
    ]


def ratio(one: dict[str, float], other: dict[str, float]) -> float:
    """Geometric mean of half-widths over others."""
    both = [name for name in one if name in other]
    return float(np.exp(np.mean([np.log(one[name] / other[name]) for name in both])))


def main() -> list[Claim]:
    """Design, play, fit."""
    claims, widths = list[Claim](), dict[tuple[str, str], dict[str, float]]()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name, plan in plans(folder).items():
            tried, simulation = played(folder, name, plan)
            told = of_play(simulation)
            print(name, *(f"{claim.name}: {claim.value}" for claim in told), sep="\n  ")
            claims += told if name == "designed" else []
            for kind, file in (("flags", tried.flags), ("forces", tried.file)):
                assert file is not None
                fit = steelyard.identify(file, tried.logs, method="least_squares", check=False)
                widths[name, kind] = {k: half for k, (_, half) in intervals(fit.model).items()}
                share = 100.0 * float(np.mean(covered(tried, fit)))
                print(f"  {kind}: {share:.0f} % of {len(widths[name, kind])} intervals hold")
                if (name, kind) == ("designed", "forces"):
                    what = f"within 95 % intervals, forces measured, of {len(widths[name, kind])}"
                    claims.append(Claim(what, f"{share:.0f} %", f">= {LEAST:g} %", share >= LEAST))
    for other, kind, most in (
        ("random", "flags", GAIN),
        ("random", "forces", GAIN),
        ("sways", "forces", BESIDE_SWAYS),
    ):
        found = ratio(widths["designed", kind], widths[other, kind])
        what = f"half-widths over those of {other}, {kind}"
        claims.append(Claim(what, f"{found:.3f}", f"<= {most:g}", found <= most))
    print(f"over sways, flags: {ratio(widths['designed', 'flags'], widths['sways', 'flags']):.2f}")
    return claims


if __name__ == "__main__":
    main_of(main)
