"""Simulated robots whose truth and prior are known: the cases of several proofs."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from proofs.support.claims import data_folder

from steelyard.base.arrays import Array, Parameters
from steelyard.base.motion import Motion
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.prior.body_priors import Knowledge, default_knowledge
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.model import Model, ValuedModel
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia
from steelyard.simulate.ground_truth import random_truth

EXAMPLES = Path(__file__).parents[2] / "examples"
NOISE = 0.05
"""Torque noise over each joint's root mean square."""

SPREAD = 0.25
"""Log-Cholesky noise between truth and prior."""

RATE = 50.0
"""Samples per second, each with noise of its own."""


@dataclass(frozen=True, eq=False)
class Case:
    """One draw.

    Attributes:
        regressor: Model and columns.
        truth: The true model.
        knowledge: What would be known by a perfect prior.
        information: What the noisy run says.
        motion: An unseen motion.
        torque: The true torque along it, shape `(N, n)`.
    """

    regressor: Regressor
    truth: ValuedModel
    knowledge: Knowledge
    information: Information
    motion: Motion
    torque: Array

    def error(self, valued: ValuedModel) -> float:
        """Mean over joints of the relative error on the unseen motion [%]."""
        error = np.linalg.norm(valued.torque(self.motion) - self.torque, axis=0)
        return float(100.0 * np.mean(error / np.linalg.norm(self.torque, axis=0)))

    def error_of(self, estimate: Estimate) -> float:
        """The same of an estimate."""
        return self.error(self.regressor.model.at(estimate.values))


def regressor_of(name: str) -> Regressor:
    """Bodies, rotors, Coulomb and viscous friction, and offsets of a shipped robot."""
    data_folder()
    return base_regressor(Model(load_robot(EXAMPLES / f"{name}.toml").robot))


def moved(regressor: Regressor, seed: int, period: float, share: float) -> Motion:
    """A random Fourier motion about its mean posture, `share` of its size and speed."""
    trajectory = random_fourier(regressor.model.robot, seed=seed, period=period, periods=1)
    motion = trajectory.sample(np.arange(0.0, period, 1.0 / RATE))
    centre = motion.q.mean(axis=0)
    return Motion(
        motion.t, centre + share * (motion.q - centre), share * motion.dq, share * motion.ddq
    )


def drawn(name: str, seed: int, *, period: float = 8.0, share: float = 1.0) -> Case:
    """A draw; poor excitation has a small `share` of the motion."""
    regressor = regressor_of(name)
    model, rng = regressor.model, np.random.default_rng(seed)
    known = default_knowledge(model)
    values = random_truth(model.robot, seed, terms=model.terms).values.as_dict()
    for body, prior in zip(known.bodies, known.priors, strict=True):
        assert prior is not None
        values |= {f"{n}.{body}": v for n, v in zip(INERTIAL_NAMES, prior.ten, strict=True)}
    truth = model.at(replaced(regressor, values))
    motion = moved(regressor, seed, period, share)
    torque = truth.torque(motion)
    torque = torque + NOISE * np.sqrt(np.square(torque).mean(axis=0)) * rng.normal(
        size=torque.shape
    )
    unseen = moved(regressor, 1000 + seed, 10.0, 1.0)
    return Case(
        regressor,
        truth,
        known,
        information_of(regressor, motion, torque),
        unseen,
        truth.torque(unseen),
    )


def replaced(regressor: Regressor, values: dict[str, float]) -> Parameters:
    """Standard parameters by name, in the model's order."""
    model = regressor.model
    return Parameters(model.names, model.units, [values.get(n, 0.0) for n in model.names])


def information_of(regressor: Regressor, motion: Motion, torque: Array) -> Information:
    """One window of samples that are all independent."""
    sums = Accumulator(regressor)(Stretch(motion.q.T, motion.dq.T, motion.ddq.T, torque.T))
    units = regressor.model.robot.effort_units
    return Information(
        regressor.layout,
        Signature("drawn", regressor.layout.columns, units, "none"),
        (Window("run", 0.0, float(motion.t[-1])),),
        sums.grams[None],
        sums.absolute[None],
        sums.counts[None],
    )


def perturbed(case: Case, rng: np.random.Generator, spread: float = SPREAD) -> Knowledge:
    """What is known of the robot: its truth with log-Cholesky noise in every body."""
    priors = tuple(_noisy(prior, rng, spread) for prior in case.knowledge.priors if prior)
    return replace(case.knowledge, priors=priors)


def _noisy(body: Inertia, rng: np.random.Generator, spread: float) -> Inertia:
    noise = spread * rng.normal(size=(4, 4))
    turned = np.diag(np.exp(np.diag(noise))) + np.triu(noise, 1)
    flipped = np.linalg.cholesky(body.pseudo[::-1, ::-1])[::-1, ::-1]
    factor = flipped @ turned
    return Inertia.from_pseudo(factor @ factor.T)


def prior_model(case: Case, knowledge: Knowledge) -> ValuedModel:
    """The model with the prior's bodies and the true friction."""
    values = case.truth.values.as_dict()
    for body, prior in zip(knowledge.bodies, knowledge.priors, strict=True):
        assert prior is not None
        values |= {f"{n}.{body}": v for n, v in zip(INERTIAL_NAMES, prior.ten, strict=True)}
    return case.regressor.model.at(replaced(case.regressor, values))
