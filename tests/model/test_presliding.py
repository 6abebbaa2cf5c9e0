"""Friction with memory against the differential equations it comes from."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from invented import single, tree
from moving import channels, cycles
from steelyard.base.arrays import Parameters
from steelyard.base.motion import Motion
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.laws.friction_with_memory import Dahl, LoadDependent, LuGre, MaxwellSlip
from steelyard.model.model import Model
from steelyard.model.terms.stateful_terms import Presliding
from steelyard.model.terms.term import Term

AMPLITUDE, REVERSALS = 0.05, 6
W = 2.0 * np.pi


def motion(per_stroke: int) -> tuple[np.ndarray, np.ndarray]:
    """Strokes of half a second that begin and end at rest; times and `(3, 1, N)` states."""
    t = np.linspace(0.0, 0.5 * REVERSALS, REVERSALS * per_stroke + 1)
    q, dq = -AMPLITUDE * np.cos(W * t), AMPLITUDE * W * np.sin(W * t)
    return t, np.stack([q, dq, -W * W * q])[:, None, :]


def integrated(rate: Callable[[float, float], float], times: np.ndarray) -> np.ndarray:
    """`ds/dt = rate(v, s)` from `s = 0`, stroke by stroke, at the times."""
    states = [np.zeros(1)]
    for k in range(REVERSALS):
        inside = times[(times > 0.5 * k + 1e-12) & (times <= 0.5 * (k + 1) + 1e-12)]
        span = (0.5 * k, 0.5 * (k + 1) + 1e-12)
        found = solve_ivp(
            lambda t, s: [rate(AMPLITUDE * W * np.sin(W * t), s[0])],
            span,
            states[-1][-1:],
            "Radau",
            inside,
            rtol=1e-10,
            atol=1e-12,
            max_step=2e-3,
        )
        states.append(found.y[0])
    return np.concatenate(states)


@pytest.mark.slow
@pytest.mark.parametrize("length", [1e-3, 0.02, 0.3])
def test_dahl_solves_its_equation(length: float) -> None:
    t, state = motion(50)
    found = channels(Dahl(length=length), single(), state)[0]
    exact = integrated(lambda v, s: v / length * (1.0 - s * np.sign(v)), t)
    assert np.abs(found - exact).max() < 1e-7


@pytest.mark.parametrize(
    "term", [Dahl(length=0.02), MaxwellSlip((0.01, 0.07)), MaxwellSlip((0.02,), True)]
)
def test_finer_samples_change_nothing(term: Term) -> None:
    """Steps are exact while the motion keeps its direction, however long."""
    coarse, fine = (channels(term, single(), motion(count)[1]) for count in (3, 300))
    assert np.abs(coarse - fine[:, ::100]).max() < 1e-12


def test_relaxing_elements_are_dahl_states() -> None:
    _, state = motion(40)
    elements = channels(MaxwellSlip((0.01, 0.05), relaxing=True), single(), state)
    for length, element in zip((0.01, 0.05), elements, strict=True):
        assert np.array_equal(element, channels(Dahl(length=length), single(), state)[0])


def test_elements_slip_at_their_length() -> None:
    q = np.array([0.0, 0.005, 0.03, 0.025, 0.0, -1.0, 0.0])
    state = np.stack([q, np.zeros(7), np.zeros(7)])[:, None, :]
    found = channels(MaxwellSlip((0.01, 0.1)), single(), state)
    assert np.allclose(found[0], [0.0, 0.5, 1.0, 0.5, -1.0, -1.0, 1.0], atol=1e-12)
    assert np.allclose(found[1], [0.0, 0.05, 0.3, 0.25, 0.0, -1.0, 1.0], atol=1e-12)


def test_the_loop_of_maxwell_slip_follows_masing() -> None:
    """Reversed at amplitude A, the force retraces the first curve at twice its scale."""
    lengths, forces = (0.01, 0.02, 0.05), np.array([1.0, 2.0, 0.5])
    up = np.linspace(0.0, 0.03, 301)
    down = 0.03 - 2.0 * up
    q = np.concatenate([up, down])
    state = np.stack([q, 0.0 * q, 0.0 * q])[:, None, :]
    force = forces @ channels(MaxwellSlip(lengths), single(), state)
    first, branch = force[:301], force[301:]
    assert np.allclose(branch, first[-1] - 2.0 * first, atol=1e-12)


LENGTH, RATIO, SPEED = 5e-3, 1.5, 0.1
BRISTLES = LuGre(length=LENGTH, breakaway=RATIO, speed=SPEED)


def level(v: float) -> float:
    return 1.0 + (RATIO - 1.0) * float(np.exp(-((v / SPEED) ** 2)))


@pytest.mark.slow
def test_lugre_approaches_its_equation() -> None:
    """A velocity held for each step: the error shrinks with the step."""
    t, _ = motion(250)
    exact = integrated(lambda v, s: (v - abs(v) * s / level(v)) / LENGTH, t)
    errors = []
    for fold in (1, 4, 16):
        found = channels(BRISTLES, single(), motion(250 * fold)[1])[:, ::fold]
        errors.append(np.abs(found[0] - exact).max())
        v = AMPLITUDE * W * np.sin(W * t)
        levels = np.array([level(x) for x in v])
        rate = (v - np.abs(v) * found[0] / levels) / LENGTH
        assert np.allclose(found[1], rate, rtol=1e-9, atol=1e-9)
    assert errors[0] < 0.03 and errors[1] < 0.3 * errors[0] and errors[2] < 0.3 * errors[1]


@pytest.mark.parametrize("seed", range(5))
def test_lugre_is_bounded(seed: int) -> None:
    """Steps of any size, and velocities that do not even belong to them."""
    rng = np.random.default_rng(seed)
    q = np.cumsum(rng.normal(size=5000) * 10.0 ** rng.uniform(-6, 1, 5000))
    dq = rng.normal(size=5000) * 10.0 ** rng.uniform(-5, 1, 5000)
    states, _ = channels(BRISTLES, single(), np.stack([q, dq, dq])[:, None, :])
    assert np.abs(states).max() <= RATIO


def test_lugre_slides_steadily_on_the_stribeck_curve() -> None:
    for v in (0.01, 0.1, -1.0):
        t = np.linspace(0.0, 20.0 * LENGTH / abs(v), 2001)
        state = np.stack([v * t, np.full_like(t, v), 0.0 * t])[:, None, :]
        states, rates = channels(BRISTLES, single(), state)
        assert states[-1] == pytest.approx(np.sign(v) * level(v), abs=1e-4)
        assert abs(rates[-1]) < 1e-3 * abs(v) / LENGTH


def test_a_resting_joint_keeps_its_friction() -> None:
    q = np.concatenate([np.linspace(0.0, 0.1, 50), np.full(50, 0.1)])
    state = np.stack([q, 0.0 * q, 0.0 * q])[:, None, :]
    for term in (Dahl(length=0.05), MaxwellSlip((0.2,)), LuGre(length=0.05)):
        found = channels(term, single(), state)[0]
        assert np.all(found[49:] == found[49]) and 0.4 < found[49] < 1.3


@pytest.mark.parametrize("term", [Dahl(), MaxwellSlip(), BRISTLES], ids=str)
def test_steps_equal_the_whole_run(term: Term) -> None:
    t, state = motion(40)
    model = Model(single(), (term,))
    valued = model.at(Parameters(model.names, model.units, np.arange(1.0, len(model.names) + 1)))
    torque = valued.torque(Motion(t, *(x.T for x in state)))
    stepper = valued.start()
    steps = [stepper.step(*state[:, :, k]) for k in range(len(t))]
    assert np.abs(np.array(steps) - torque).max() < 1e-12 * np.abs(torque).max()


LOADED = LoadDependent(length=1e-3, along=(("sum", (("trunk_joint", 1.0), ("left_joint", -2.0))),))


@pytest.mark.parametrize(
    "term", [Dahl(), MaxwellSlip(), MaxwellSlip(relaxing=True), LuGre(), LOADED]
)
def test_steps_of_one_sample_are_those_along_a_log(term: Presliding) -> None:
    """A motion that begins at some speed, so that its first states are not zero."""
    robot, state = tree(), 0.01 * cycles(4, 1, 200)
    whole, memory, found = channels(term, robot, state), None, []
    for q, dq, ddq in state.transpose(2, 0, 1):
        sample = JointState(q, dq, ddq)
        memory = term.started(robot, sample) if memory is None else memory
        assert len(memory) == term.n_memory(robot)
        memory, now = term.stepped(robot, sample, memory)
        found.append(now)
    assert np.abs(whole[:, 0]).max() > 0.1
    np.testing.assert_allclose(
        np.transpose(found), whole, rtol=0.0, atol=1e-12 * np.abs(whole).max()
    )
