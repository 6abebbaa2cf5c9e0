"""Frozen encoders and dead efforts are found and left out of the run, with a note."""

from collections.abc import Callable

import numpy as np

from steelyard.runs.first_pass_over_recording import dead_efforts, frozen_positions
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LeftOut

RATE = 200.0
Parts = tuple[np.ndarray, np.ndarray, np.ndarray]


def logged(sines: Callable[[np.ndarray], dict[str, np.ndarray]]) -> Parts:
    """Time, positions of an encoder with steps, and noisy efforts of 20 s."""
    rng, t = np.random.default_rng(3), np.arange(20.0 * RATE) / RATE
    motion = sines(t)
    effort = motion["effort"] + 0.01 * rng.normal(size=motion["q"].shape)
    return t, np.round(motion["q"], 5), effort


def test_a_dead_effort_does_not_count_and_others_do(recording, sines) -> None:
    t, q, effort = logged(sines)
    effort[1000:1400, 1] = effort[1000, 1]
    run = prepare(recording(t, q, effort))
    (stretch,) = run.recording.left_out
    assert (stretch.start, stretch.stop, stretch.joints) == (5.0, 6.995, (1,))
    whole = run.whole()
    inside = (whole.t > 5.0) & (whole.t < 6.99)
    assert whole.weights is not None
    assert not whole.moving[inside, 1].any() and not whole.weights[inside, 1].any()
    assert whole.moving[inside, 0].any() and (whole.weights[inside, 0] == 1.0).all()
    assert "efforts of tau_1 from 5 to 6.995 s left out" in " ".join(run.quality.losses)
    assert run.unmeasured(whole.t)[1, inside].all() and not run.unmeasured(whole.t)[0].any()
    pushed = run.leaving_out([LeftOut(8.0, 9.0, "a force", (0,))])
    assert not pushed.unmeasured(whole.t)[0].any()  # of a fit, not of the log
    kept = prepare(recording(t, q, effort), Processing(leave_out_saturated=False))
    assert kept.recording.left_out == ()


def test_all_efforts_that_die_are_left_out(recording, sines) -> None:
    t, q, effort = logged(sines)
    effort[2000:2600] = 0.0
    run = prepare(recording(t, q, effort))
    assert {s.joints for s in run.recording.left_out} == {(0,), (1,)}
    assert {(s.start, s.stop) for s in run.recording.left_out} == {(10.0, 12.995)}


def test_rows_with_a_frozen_encoder_are_a_gap(recording, sines) -> None:
    t, q, effort = logged(sines)
    q[1000:1600, 0] = q[1000, 0]
    run = prepare(recording(t, q, effort))
    (stretch,) = run.recording.left_out
    assert (stretch.start, stretch.stop, stretch.joints) == (5.0, 7.995, ())
    assert run.quality.dropped == {"a frozen position": 600}
    assert not ((run.whole().t > 5.0) & (run.whole().t < 7.99)).any()
    assert "5 to 7.995 s left out: an encoder is frozen" in " ".join(run.quality.losses)


def test_rest_coarse_efforts_and_saturation_are_no_dead_stretches(sines) -> None:
    t, q, effort = logged(sines)
    assert dead_efforts(q, effort) == () and frozen_positions(q, np.full(2, 1e-5)) == ()
    assert dead_efforts(q, np.round(effort, 0)) == ()  # levels of 1 Nm
    still = q.copy()
    still[1000:1400] = still[1000]
    effort[1000:1400] = effort[1000]
    assert dead_efforts(still, effort) == ()  # a brake holds
    limited = np.minimum(logged(sines)[2], 1.0)
    assert dead_efforts(q, limited) == ()


def test_an_effort_that_is_mostly_constant_is_not_made_sound(sines) -> None:
    t, q, effort = logged(sines)
    effort[:, 0] = 0.0
    assert all(joint == 1 for joint, _, _ in dead_efforts(q, effort))
