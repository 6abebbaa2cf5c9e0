"""A motion of an invented arm, with all that a design says of it."""

from dataclasses import replace

import numpy as np

from steelyard.excite.constraints.certificate import certify
from steelyard.excite.constraints.constraint_and_limits import motion_limits
from steelyard.excite.constraints.tool_workspace import Marker, tool_box
from steelyard.excite.design_problem_and_information import Case, InformationEvaluator
from steelyard.excite.optimality_criteria import CRITERIA, measure
from steelyard.excite.predicted_accuracy_and_advice import advised_motions, predicted_accuracy
from steelyard.excite.searched_or_planned_motion import Designed
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.robot import Frame, Robot

REACH = 0.8
"""Length of the arm: two links of 0.4 m about y."""


def with_tip(arm: Robot) -> Robot:
    """The arm with a frame at its end."""
    return arm.changed(frames=(Frame("tip", arm.n - 1, np.eye(3), np.array([0.4, 0.0, 0.0])),))


def designed_for(arm: Robot, *, height: float = 1.0, known: bool = True) -> Designed:
    """A random motion of an arm with two joints, described like a design.

    Args:
        arm: The arm.
        height: Upper wall of the tool's box [m]; what is below 0.8 is passed.
        known: Whether values of the parameters are known.
    """
    arm = with_tip(arm)
    tool, limits = Marker("tip"), motion_limits(arm)
    motion = random_fourier(arm, seed=1, period=4.0, harmonics=4)
    model = Model(arm, (RigidBody(), Viscous(), Coulomb()))
    kind = CRITERIA["condition"]
    cases = [
        Case(
            InformationEvaluator(model, np.ones(arm.n), np.full(arm.n, 0.01)),
            measure(kind, None, None),
        )
    ]
    box = tool_box(arm, tool, (-1.0, None, -height), (1.0, None, height))
    noise = np.array([0.5, 0.2])
    weights = 20.0 / noise**2
    seen = predicted_accuracy(motion, cases, weights, 400)
    sizes = np.arange(1.0, len(seen.names) + 1.0)
    return Designed(
        robot=arm,
        trajectory=motion,
        kind="fourier",
        limits=limits,
        certificate=certify(arm, motion, limits, (box,)),
        criterion=cases[0].criterion.name,
        shown=seen,
        course=((0.5, 2.0 * seen.criterion_value), (1.25, 1.1 * seen.criterion_value)),
        searches=7,
        seconds=2.5,
        stopped=False,
        noise=noise,
        noise_from="assumed: something",
        prior=None,
        values=dict(zip(seen.names, sizes, strict=True)) if known else {},
        advice=advised_motions(seen, motion, cases, weights, limits),
        tool=tool,
        notes=("the acceleration is a guess",),
    )


def renamed(designed: Designed, name: str) -> Designed:
    """The same with a stranger's name in all places that a file may fill."""
    arm = designed.robot
    coordinates = tuple(replace(c, name=f"{c.name}{name}") for c in arm.coordinates)
    certificate = designed.certificate
    extremes = tuple(replace(x, joint=f"{x.joint}{name}") for x in certificate.extremes)
    proofs = tuple(
        replace(p, name=f"{p.name}{name}", labels=tuple(f"{x}{name}" for x in p.labels))
        for p in certificate.proofs
    )
    names = tuple(f"{x}{name}" for x in designed.shown.names)
    more = tuple(
        replace(one, what=name, helps=tuple((f"{x}{name}", share) for x, share in one.helps))
        for one in designed.advice
    )
    frames = tuple(replace(frame, name=name) for frame in arm.frames)
    return replace(
        designed,
        robot=arm.changed(name=name, coordinates=coordinates, frames=frames),
        kind=name,
        criterion=name,
        certificate=replace(certificate, how=name, extremes=extremes, proofs=proofs),
        shown=replace(designed.shown, names=names),
        noise_from=name,
        advice=more,
        tool=Marker(name),
        notes=(name,),
    )
