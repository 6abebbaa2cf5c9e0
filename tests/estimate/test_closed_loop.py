"""Laws that every estimator keeps that simulates the closed loop."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from invented import dh_arm
from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.base.motion import Motion
from steelyard.base.progress import Event, Stopped
from steelyard.estimate.closed_loop.extended_kalman_filter import (
    KalmanParameters,
    torque_noise,
    white_noise,
)
from steelyard.estimate.closed_loop.feedback_and_forward_dynamics import (
    Forward,
    Integration,
    JointPD,
    tuned_pd,
)
from steelyard.estimate.closed_loop.simulated_experiment import (
    Experiment,
    Measured,
    RunController,
    simulate,
)
from steelyard.estimate.closed_loop.simulating_estimators import (
    ClosedLoopOutputError,
    Didim,
    InstrumentalVariables,
    filtered,
)
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.estimator_register import ESTIMATORS, Context, Offer
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.prior.body_priors import default_knowledge
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.laws.laws_without_friction import RigidBody, RotorInertia
from steelyard.model.model import Model
from steelyard.robot.file.signals import Signals
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording

RATE, LENGTH, CUTOFF = 1000.0, 2.5, 20.0
TERMS = (RigidBody(), RotorInertia(), Coulomb(smoothing=0.05), Viscous())

OFFERS = [offer for offer in ESTIMATORS if offer.needs == "experiment"]
EXACT = {"IV": 2e-4, "EKF": 2e-3}
"""Torque error on exact data, over the torque; others 1e-6. Accelerations of IV are differences
over two milliseconds, and the filter believes in a little noise."""

every = pytest.mark.parametrize("offer", OFFERS, ids=lambda offer: offer.name)


@cache
def regressor() -> Regressor:
    return base_regressor(Model(dh_arm(), TERMS))


@cache
def truth() -> Array:
    model = regressor().model
    laws = {"rotor_inertia": 0.3, "coulomb": 1.5, "viscous": 0.8}
    known = [
        p.prior if p.prior is not None else laws[p.name.split(".")[0]] for p in model.parameters
    ]
    return frozen(regressor().base.base_values(known))


@cache
def loop() -> RunController:
    motion = random_fourier(dh_arm(), seed=3, period=LENGTH, harmonics=4)
    dynamics = Forward(regressor().model, regressor().base.independent)
    q = np.random.default_rng(0).normal(size=(3, 20))
    masses = dynamics.mass_and_bias(q, np.zeros_like(q), truth(), np.ones(3))[0]

    def wanted(t: Array) -> tuple[Array, Array]:
        goal = motion.sample(np.clip(t, 0.0, LENGTH))
        return goal.q, goal.dq

    return RunController(tuned_pd(masses), wanted)


def driven(position: float = 0.0, seed: int = 0) -> tuple[Array, Array, Array]:
    """The true arm under its controller, which feels noisy positions: `q`, `dq` and torque."""
    rng = np.random.default_rng([seed, 7])
    moving = Integration(
        Forward(regressor().model, regressor().base.independent), truth()[:, None], np.ones(3)
    )
    t = np.arange(round(LENGTH * RATE) + 1) / RATE
    goal, speed = loop().wanted(t)
    moving.q[:, 0] = goal[0]
    q, dq, tau = np.zeros((3, len(t), 3))
    previous = None
    for k in range(len(t)):
        felt = moving.q[:, 0] + position * rng.standard_normal(3)
        commanded = loop().controller.torque(goal[k] - felt, speed[k] - moving.dq[:, 0])
        q[k], dq[k], tau[k] = (
            felt,
            moving.dq[:, 0],
            commanded if previous is None else 0.5 * (previous + commanded),
        )
        previous = commanded
        moving.effort[:, 0] = commanded
        moving.advance(1.0 / RATE)
    return q, dq, tau


@cache
def experiment(position: float = 0.0, torque: float = 0.0, seed: int = 0) -> Experiment:
    """One run; accelerations are differences, behind no filter where there is no noise."""
    q, dq, tau = driven(position, seed)
    t = np.arange(len(q)) / RATE
    rng = np.random.default_rng([seed, 8])
    measured = tau + torque * np.std(tau, axis=0) * rng.standard_normal(tau.shape)
    ddq = np.gradient(dq, 1.0 / RATE, axis=0)
    run = Measured("run", RATE, Motion(t, q, dq, ddq), q, measured, np.ones(q.shape), CUTOFF)
    sums = Accumulator(regressor(), run.matched)(Stretch(q.T, dq.T, ddq.T, measured.T))
    layout = regressor().layout
    information = Information(
        layout,
        Signature("model", layout.columns, ("Nm",) * 3, "none"),
        (Window("run", 0.0, LENGTH),),
        sums.grams[None],
        sums.absolute[None],
        sums.counts[None],
    ).with_effective_samples(run.matched.inflation)
    return Experiment(regressor(), (run,), (loop(),), information)


def exact() -> Experiment:
    return experiment()


def made(offer: Offer) -> object:
    return offer.make(Context(regressor(), default_knowledge(regressor().model)))


def torque_error(estimate: Estimate) -> float:
    """Relative error of the torque on another motion."""
    q, dq, ddq = np.random.default_rng(5).normal(size=(3, 3, 300))
    dense = regressor().dense(q, dq, ddq)
    known = estimate.parameters.as_dict()
    values = np.array([known.get(name, 0.0) for name in regressor().layout.columns])
    wanted = dense @ truth()
    return float(np.linalg.norm(dense @ values - wanted) / np.linalg.norm(wanted))


@pytest.mark.slow
@every
def test_exact_data_give_the_truth(offer: Offer) -> None:
    estimate = made(offer)(exact())  # type: ignore[operator]
    assert torque_error(estimate) < EXACT.get(offer.name, 1e-6)
    assert estimate.parameters.names == regressor().layout.columns
    assert np.isfinite(estimate.covariance).all()
    assert np.linalg.eigvalsh(estimate.covariance)[0] > -1e-12
    assert estimate.blind == ()


@pytest.mark.slow
@every
def test_intervals_hold_the_truth(offer: Offer) -> None:
    inside = total = 0
    for seed in range(2):
        data = experiment(1e-6, 0.01, seed)
        estimate = made(offer)(data)  # type: ignore[operator]
        inside += int(np.sum(np.abs(estimate.parameters.values - truth()) <= estimate.half_width))
        total += len(truth())
    assert inside / total > 0.85


@pytest.mark.slow
@every
def test_noise_of_positions_does_not_bias_as_it_biases_least_squares(offer: Offer) -> None:
    data = differenced(6e-4, 0.01)
    assert torque_error(data.start) > 0.05
    assert torque_error(made(offer)(data)) < 0.3 * torque_error(data.start)  # type: ignore[operator]


@cache
def differenced(position: float, torque: float) -> Experiment:
    """An experiment whose motion is from noisy positions behind a generous low-pass."""
    from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import Butterworth

    data = experiment(position, torque)
    (run,) = data.runs
    motion = Butterworth().designed(60.0, RATE)
    halo = motion.halo
    padded = np.pad(run.q, ((halo, halo), (0, 0)), mode="reflect", reflect_type="odd")
    q, dq, ddq = motion(padded.T, None).reshape(3, 3, -1)
    sums = Accumulator(regressor(), run.matched)(Stretch(q, dq, ddq, run.tau.T))
    information = replace(data.information, grams=sums.grams[None], absolute=sums.absolute[None])
    information = replace(information, counts=sums.counts[None]).with_effective_samples(
        run.matched.inflation
    )
    moved = replace(run, motion=Motion(run.motion.t, q.T, dq.T, ddq.T))
    return replace(data, runs=(moved,), information=information)


@every
def test_work_can_be_stopped(offer: Offer) -> None:
    events: list[Event] = []

    def watch(event: Event) -> bool:
        events.append(event)
        return len(events) < 3

    context = Context(regressor(), default_knowledge(regressor().model), progress=watch)
    with pytest.raises(Stopped):
        offer.make(context)(exact())
    assert events[0].phase == "simulating run"


@pytest.mark.parametrize(
    "estimator",
    [
        InstrumentalVariables(rounds=1),
        Didim(rounds=1),
        ClosedLoopOutputError(rounds=1),
        KalmanParameters(rounds=1),
    ],
    ids=lambda e: type(e).__name__,
)
def test_what_did_not_converge_is_not_called_solved(estimator: object) -> None:
    data = differenced(6e-4, 0.01)
    with pytest.raises(DataError, match="did not converge within 1 rounds"):
        estimator(data)  # type: ignore[operator]


@every
def test_a_loop_that_is_not_the_logs_runs_away(offer: Offer) -> None:
    wrong = replace(loop(), controller=JointPD(np.full(3, -500.0), np.zeros(3)))
    with pytest.raises(DataError, match="diverged") as caught:
        made(offer)(replace(exact(), loops=(wrong,)))  # type: ignore[operator]
    assert "controller" in caught.value.fix


@pytest.mark.slow
def test_the_kalman_filter_says_where_it_diverged() -> None:
    (run,) = exact().runs
    jumped = np.where(np.arange(len(run.q))[:, None] < 1000, run.q, run.q + 2.0)
    with pytest.raises(DataError, match=r"diverged at 1\.00 s: it is more than 0\.5 rad"):
        KalmanParameters()(replace(exact(), runs=(replace(run, q=jumped),)))


@pytest.mark.slow
def test_simulated_lanes_are_what_single_ones_are() -> None:
    lanes = truth()[:, None] * [1.0, 1.1, -1.0]
    (together,) = simulate(exact(), lanes)
    (alone,) = simulate(exact(), lanes[:, 1])
    assert np.allclose(together.tau[..., 1], alone.tau[..., 0], rtol=0.0, atol=1e-9)
    assert together.sound.tolist() == [True, True, False]
    assert together.possible.tolist() == [True, True, False]
    (run,) = exact().runs
    assert np.allclose(together.tau[..., 0], run.tau, rtol=0.0, atol=1e-8)
    assert np.allclose(together.motion[0], run.q, rtol=0.0, atol=1e-11)


@pytest.mark.slow
def test_where_least_squares_cannot_move_the_model_file_begins() -> None:
    data = exact()
    broken = data.information.scaled(np.full(3, -1.0), ("Nm",) * 3)
    start_values = replace(data, information=broken).start_values
    assert start_values.notes and "inertial parameters of the model file" in start_values.notes[0]
    assert not exact().start_values.notes
    estimate = Didim()(replace(data, information=broken))
    assert torque_error(estimate) < 1e-6
    assert "inertial parameters of the model file" in " ".join(estimate.notes)


def test_the_matched_filter_is_that_of_the_pass() -> None:
    (run,) = exact().runs
    dense = regressor().dense(run.motion.q.T, run.motion.dq.T, run.motion.ddq.T)
    matrix = np.zeros((dense.shape[2],) * 2)
    for row in dense:
        kept = filtered(row, run.matched)
        matrix += kept.T @ kept / run.matched.inflation
    wanted = exact().information.normal(np.ones(3))[0]
    assert np.allclose(matrix, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


def test_noise_is_found_from_signals() -> None:
    rng = np.random.default_rng(0)
    t = np.arange(4000) / 1000.0
    smooth = np.column_stack((np.sin(5.0 * t), 30.0 * np.sign(np.sin(3.0 * t))))
    noise = rng.standard_normal((4000, 2)) * [1e-5, 0.2]
    assert np.allclose(white_noise(smooth + noise), [1e-5, 0.2], rtol=0.1)
    felt = 1e-4 * rng.standard_normal((4000, 2))
    answered = -8000.0 * (felt + np.roll(felt, 1, axis=0)) / 2.0 + noise
    assert np.allclose(torque_noise(answered, smooth[:, :1] + felt), [1e-5, 0.2], rtol=0.1)
    assert white_noise(answered)[0] > 0.2


def recording(torques: Array, gains: tuple[bool, ...] = ()) -> Recording:
    """The exact run as a log."""
    (run,) = exact().runs
    names = [f"{kind}{j}" for kind in "qe" for j in range(3)]
    signals = Signals(
        time="t",
        time_scale=1.0,
        position=tuple(names[:3]),
        position_scale=np.ones(3),
        velocity=None,
        velocity_scale=None,
        effort=tuple(names[3:]),
        effort_scale=np.ones(3),
        effort_kind="joint_torque",
        effort_units=("Nm",) * 3,
        gains=np.full(3, 2.0),
        unknown_gains=gains,
    )
    rng = np.random.default_rng(2)
    q = run.q + 1e-6 * rng.standard_normal(run.q.shape)
    table = np.column_stack((run.motion.t, q, torques))
    return Recording(LogInMemory(Path("run"), ("t", *names), table), signals)


@pytest.mark.slow
def test_a_log_without_controller_gets_one_that_stands_in() -> None:
    (run,) = exact().runs
    rng = np.random.default_rng(3)
    noisy = 0.5 * (run.tau + 0.01 * rng.standard_normal(run.tau.shape))
    log = prepare(recording(noisy), Processing(motion_cutoff=40.0, matched_cutoff=20.0))
    data = Experiment.of_runs(regressor(), [log])
    assert "is assumed" in data.notes[0]
    assert np.allclose(data.runs[0].q, run.q[-len(data.runs[0].q) :], atol=0.5)
    for estimator in (
        InstrumentalVariables(),
        Didim(),
        ClosedLoopOutputError(),
        KalmanParameters(),
    ):
        estimate = estimator(data)
        assert torque_error(estimate) < 0.01
        assert any("is assumed" in note for note in estimate.notes)
    known = replace(data, loops=(loop(),) * len(data.runs), notes=())
    assert torque_error(Didim()(known)) < 0.01


def test_logs_that_cannot_be_simulated_are_refused() -> None:
    (run,) = exact().runs
    with pytest.raises(DataError, match="needs joint torques"):
        Experiment.of_runs(regressor(), [prepare(recording(run.tau, (True, False, False)))])
    memory = base_regressor(Model(dh_arm(), (RigidBody(), Dahl(length=1e-3))))
    with pytest.raises(DataError, match="its friction has internal states"):
        Experiment.of_runs(memory, [prepare(recording(run.tau))])
