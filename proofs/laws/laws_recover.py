"""Every law recovers itself from the virtual robot: do the stated 95 % intervals hold the truth?

Each law of the register is the true physics of a two-joint arm, with other laws beside it; a log
with 2 % torque noise goes through the whole identification: file, recording, preparation, pass,
weighted least squares. Fields are known. 20 draws a law, each with a truth, motion and noise of
its own.
"""

import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from proofs.support.claims import Claim, main_of

from steelyard.base.motion import run
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.logs.formats import open_log
from steelyard.model.laws.register import term_of
from steelyard.model.terms.term import Term
from steelyard.robot.file.signals import Signals
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Body, Coordinate, Frame, Limits, Robot
from steelyard.runs.prepare import prepare
from steelyard.runs.recording import Recording
from steelyard.simulate.drives_sensors_and_loads import Sensors
from steelyard.simulate.ground_truth import random_truth
from steelyard.simulate.mujoco_model import build
from steelyard.simulate.typical_torques_and_masses import typical_torque
from steelyard.simulate.virtual_robot import VirtualRobot

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from law_cases import LawCase, simulated  # noqa: E402

DRAWS, PERIOD, PERIODS = 20, 5.0, 1
TORQUE_NOISE = 0.02
"""White torque noise over the typical torque of each joint."""

SHARPER = 0.1
"""Smoothing speeds of laws that jump at zero speed, of the customary ones."""


def arm() -> Robot:
    """Two links: one turns about a vertical axis that is tilted, one about a horizontal axis."""
    limits = Limits(-1.5, 1.5, 3.0)

    def body(name: str, joint: str, number: int, position: Sequence[float], axis: Any) -> Body:
        mass = Inertia.about_com(3.0 - number, [0.2, 0.02, 0.03], np.diag([0.01, 0.04, 0.04]))
        return Body(
            name, joint, "revolute", number - 1, np.eye(3), np.array(position), axis, number,
            inertia=mass, known=True,
        )  # fmt: skip

    bodies = (
        body("thigh", "hip", 0, (0.0, 0.0, 0.0), np.array([0.0, 1.0, 0.0])),
        body("shank", "knee", 1, (0.4, 0.0, 0.0), np.array([0.0, 0.6, 0.8])),
    )
    joints = (Coordinate("hip", "revolute", limits), Coordinate("knee", "revolute", limits))
    base = Frame("base", -1, np.eye(3), np.zeros(3))
    return Robot("leg", bodies, joints, frames=(base,))


def cases() -> list[tuple[LawCase, Term, tuple[Term, ...]]]:
    """Every law, and the terms of its model."""
    found = []
    for case in simulated(arm(), recovered=True):
        term = case.on(arm())
        beside = ["rigid_body", "rotor_inertia", *case.beside]
        others = [x for table in beside if (x := term_of(table, "proof")).law != case.law]
        found.append((case, term, (*others, term)))
    return found


def signals_of(robot: Robot) -> Signals:
    """What the virtual robot's log is read as."""
    ones, numbers = np.ones(robot.n), range(1, robot.n + 1)
    return Signals(
        time="time_s",
        time_scale=1.0,
        position=tuple(f"q{j}_rad" for j in numbers),
        position_scale=ones,
        velocity=None,
        velocity_scale=None,
        effort=tuple(f"tau{j}_Nm" for j in numbers),
        effort_scale=ones,
        effort_kind="joint_torque",
        effort_units=robot.effort_units,
        gains=ones,
    )


def errors(robot: Robot, terms: tuple[Term, ...], seed: int, folder: Path) -> dict[str, float]:
    """Error of every base parameter over its 95 % half-width."""
    truth = random_truth(robot, seed, terms=terms)
    truth = replace(truth, smoothing=SHARPER * truth.smoothing)
    scale = typical_torque(robot, build(robot, truth.inertial, truth.rotors))
    sensors = Sensors(
        resolution=2.0 * np.pi / 2**20, torque_noise=TORQUE_NOISE * scale, velocity=False
    )
    motion = random_fourier(robot, seed=seed, period=PERIOD, periods=PERIODS)
    run(VirtualRobot(robot, truth, sensors, seed=seed, rest=0.3), motion, folder / "log.parquet")
    clean = prepare(Recording(open_log(folder / "log.parquet"), signals_of(robot)))
    regressor = base_regressor(truth.model)
    estimate = WeightedLeastSquares()(gather(regressor, clean))
    values = regressor.base.base_values(truth.values.values)
    true = dict(zip(regressor.base.base_names, values, strict=True))
    found = estimate.parameters
    return {
        name: abs(value - true[name]) / width
        for name, value, width in zip(found.names, found.values, estimate.half_width, strict=True)
    }


def coverage_of(number: int) -> tuple[str, int, int, int, int]:
    """A law, and of its model's and its own parameters how many are covered, and how many exist."""
    case, term, terms = cases()[number]
    mine = {p.name for p in term.parameters(arm())}
    good = count = own = owned = 0
    with tempfile.TemporaryDirectory() as name:
        for draw in range(DRAWS):
            for parameter, error in errors(arm(), terms, 1000 * number + draw, Path(name)).items():
                count, good = count + 1, good + (error <= 1.0)
                if parameter in mine:
                    owned, own = owned + 1, own + (error <= 1.0)
    fields = ", ".join(f"{k} {v}" for k, v in case.fields.items() if isinstance(v, float | str))
    return f"{term.law} {fields}".strip(), good, count, own, owned


def main(laws: Sequence[str] = ()) -> list[Claim]:
    """Coverage of each law over all parameters of its model, and of all together."""
    numbers = [k for k, (case, *_) in enumerate(cases()) if not laws or case.law in laws]
    claims, inside, total = [], 0, 0
    # a fork of a process with threads, which other proofs leave behind, may hang
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        for law, good, count, own, owned in pool.map(coverage_of, numbers):
            inside, total = inside + good, total + count
            share = 100.0 * good / count
            mine = f", its own {100.0 * own / owned:.0f} %" if owned else ""
            claims.append(
                Claim(f"{law}: {count} pairs", f"{share:.1f} %{mine}", ">= 90 %", share >= 90.0)
            )
    share = 100.0 * inside / total
    return [*claims, Claim(f"all laws: {total} pairs", f"{share:.1f} %", ">= 90 %", share >= 90.0)]


if __name__ == "__main__":
    main_of(lambda: main(sys.argv[1:]))
