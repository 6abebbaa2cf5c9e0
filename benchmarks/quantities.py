"""Quantities of a model with seven joints and friction: sample by sample, and along motions.

Beside them Pinocchio's functions in C++, called from Python sample by sample: rigid bodies alone,
without friction and without checks of the arguments.
"""

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin

from oracles import pinocchio_model
from steelyard.base.arrays import Parameters
from steelyard.model.equations.frame_and_point_kinematics import last_frame
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.model import Model, ValuedModel

STEPS, SAMPLES = 100, 50_000
Best = Callable[[Callable[[], object], int], float]
Row = tuple[str, str, str, bool]


def quantities(best: Best, model: Model) -> list[Row]:
    """All rows."""
    values = np.random.default_rng(0).uniform(0.1, 1.0, len(model.names))
    nominal = model.robot.nominal.ravel()
    values[: len(nominal)] = nominal
    valued = model.at(Parameters(model.names, model.units, values))
    return [*steps(best, valued), *motions(best, valued)]


def steps(best: Best, valued: ValuedModel) -> list[Row]:
    """One sample after another."""
    stepper, tool = valued.start(), last_frame(valued.robot)
    oracle = pinocchio_model(valued.robot)
    data = oracle.createData()
    samples = list(np.random.default_rng(1).normal(size=(STEPS, 3, valued.robot.n)))

    def each(call: Callable[..., object]) -> float:
        def loop() -> None:
            for q, dq, ddq in samples:
                call(q, dq, ddq)

        loop()
        return 1e6 * best(loop, 300) / STEPS

    def observed(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> Sequence[np.ndarray]:
        stepper.friction(q, dq, ddq)
        stepper.momentum(q, dq)
        stepper.momentum_rate(q, dq)
        return stepper.jacobian(q, tool)

    torque, theirs = each(stepper.step), each(lambda *x: pin.rnea(oracle, data, *x))
    mass = each(lambda q, dq, ddq: stepper.mass_matrix(q))
    slipping = each(_slipping(valued).start().step)
    forward, observer = each(stepper.forward_dynamics), each(observed)
    return [
        ("torque, sample by sample", f"{torque:.1f} µs a step", "<= 5 µs", torque <= 5.0),
        ("with Dahl's friction", f"{slipping:.1f} µs a step", "<= 5 µs", slipping <= 5.0),
        ("rnea of Pinocchio, sample by sample", f"{theirs:.1f} µs a step", "", True),
        ("mass matrix, sample by sample", f"{mass:.1f} µs a step", "", True),
        ("forward dynamics, sample by sample", f"{forward:.1f} µs a step", "", True),
        (
            "friction, momentum, its rate and a Jacobian",
            f"{observer:.1f} µs a step",
            "<= 20 µs",
            observer <= 20.0,
        ),
    ]


def _slipping(valued: ValuedModel) -> ValuedModel:
    """The same bodies with friction that has memory."""
    terms = tuple(Dahl() if term.law == "coulomb" else term for term in valued.model.terms)
    model = Model(valued.robot, terms)
    return model.at(Parameters(model.names, model.units, valued.values.values))


def motions(best: Best, valued: ValuedModel) -> list[Row]:
    """Whole motions against a loop over Pinocchio."""
    oracle = pinocchio_model(valued.robot)
    data = oracle.createData()
    q, dq, ddq = np.random.default_rng(2).normal(size=(3, SAMPLES, valued.robot.n))
    samples = list(zip(q, dq, ddq, strict=True))

    def loop(call: Callable[..., object], count: int) -> Callable[[], None]:
        def work() -> None:
            for sample in samples:
                call(oracle, data, *sample[:count])

        return work

    pairs = {
        "torque": (lambda: valued.torque(q, dq, ddq), loop(pin.rnea, 3)),
        "mass matrix": (lambda: valued.mass_matrix(q), loop(pin.crba, 1)),
        "forward dynamics": (lambda: valued.forward_dynamics(q, dq, ddq), loop(pin.aba, 3)),
    }
    rows: list[Row] = []
    for name, (ours, theirs) in pairs.items():
        ours()
        mine, other = (1e9 * best(work, 5) / SAMPLES for work in (ours, theirs))
        figure = f"{mine:.0f} ns a sample, Pinocchio {other:.0f} ns: {other / mine:.1f} times"
        rows.append((f"{name} along a motion", figure, "", True))
    return rows
