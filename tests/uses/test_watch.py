"""Contacts and changes of a payload as samples arrive."""

import numpy as np
import pytest

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.estimate.external.contact_thresholds import ONSET, ContactThresholds
from steelyard.estimate.scores.residual_traces_and_band_calibration import ResidualTrace
from steelyard.uses.contact.contact import ContactEvent, ContactStart, ContactStream, contacts_in
from steelyard.uses.payload.change_detection import SlidingMass
from steelyard.uses.payload.pick_up_and_put_down import Kind, PayloadEvent, PayloadEvents
from steelyard.uses.watch.watcher_and_events import (
    FIRST_SEARCH,
    SEARCH_PERIOD,
    SEARCHED_SPAN,
    Doubt,
    PayloadStream,
)
from uses.test_contact import EDGES, ROBOT, SIGMA, STEP, N, pushed, silent, trace


def streamed(
    run: ResidualTrace, limits: Array, changes: Array | None = None
) -> list[ContactStart | ContactEvent]:
    """All that a stream of a trace reports; a change is decided `ONSET` later."""
    stream, late = ContactStream(ROBOT, SIGMA), round(ONSET / STEP)
    some = np.full((N, len(run.t)), np.nan) if changes is None else run.changes(EDGES)
    nothing = np.full((N, late), np.nan)
    some = np.concatenate([nothing, some], axis=1)
    known = np.full(N, np.nan) if changes is None else changes
    found = []
    for k, t in enumerate(run.t):
        signal, levels = np.stack([run.residual[:, k], some[:, k]]), np.stack([limits[:, k], known])
        times = (float(t), float(run.t[max(k - late, 0)]))
        gap = bool(k > 0 and t - run.t[k - 1] > 2.0 * STEP)
        found += list(stream.step(float(t), signal, levels, times, gap=gap))
    return [*found, stream.ended()] if stream.active else found


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("gaps", [False, True])
def test_contacts_of_a_stream_are_those_of_the_whole_log(seed: int, gaps: bool) -> None:
    run = trace("run", 60.0, seed)
    run = pushed(run, 20.0, 21.0, 1, 60.0)
    if gaps:
        run = run.of((run.t % 7.0) > 0.3)
    values = np.array([4.0, 5.0, 6.0, 8.0, 7.0]) * np.ones((N, 5))
    values[0] = np.nan
    never = np.full(N, np.nan)
    thresholds = ContactThresholds(EDGES, 8.0, 1.0, 60.0, values, ((True,) * 5,) * N, never)
    wanted = contacts_in(run, thresholds, ROBOT, SIGMA)
    found = streamed(run, thresholds.at(run.ranges(EDGES)))
    ends = [event for event in found if isinstance(event, ContactEvent)]
    assert len(wanted) > 2 and len(found) == 2 * len(ends)
    assert [e.to_dict() for e in ends] == [e.to_dict() for e in wanted]
    starts = [event for event in found if isinstance(event, ContactStart)]
    assert [s.time for s in starts] == [e.start for e in wanted]


def test_changes_at_rest_are_those_of_the_whole_log() -> None:
    run = pushed(pushed(silent(), 5.0, 5.6, 1, -2.0), 7.5, 8.0, 0, 3.0)
    changes = np.ones(N)
    thresholds = ContactThresholds(
        EDGES, 8.0, 1.0, 60.0, np.full((N, 5), 9.0), ((True,) * 5,) * N, changes
    )
    wanted = contacts_in(run, thresholds, ROBOT, SIGMA)
    found = streamed(run, thresholds.at(run.ranges(EDGES)), changes)
    ends = [event for event in found if isinstance(event, ContactEvent)]
    starts = [event for event in found if isinstance(event, ContactStart)]
    assert len(wanted) == 2 and all(event.joints[0].change for event in wanted)
    for one, other, start in zip(ends, wanted, starts, strict=True):
        assert one.joints == other.joints and one.links == other.links
        assert (one.start, one.end) == (other.start, other.end) and start.time == other.start
        assert one.known == pytest.approx(other.known) == start.known


def test_a_contact_at_the_end_of_a_stream_is_ended() -> None:
    run = pushed(silent(), 9.0, 11.0, 1, -4.0)
    first, last = streamed(run, np.ones((N, len(run.t))))
    assert isinstance(first, ContactStart) and first.joint.peak == -4.0
    assert isinstance(last, ContactEvent) and last.start == first.time
    assert first.place == last.place


KINDS: dict[float, Kind] = {13.0: "picked up", 54.0: "put down"}
"""Changes of a payload by their times [s]."""


NO_MASS = SlidingMass(np.zeros(0), np.zeros(0), np.zeros(0))


class Search:
    """Finds the changes that have motion on both sides in the rows; some searches fail."""

    def __init__(self, *fails: int, least: tuple[float, ...] = (0.5,)) -> None:
        self.fails, self.least = fails, least
        self.lengths: list[float] = []

    def __call__(self, rows: Array) -> PayloadEvents:
        start, stop = float(rows[0, 0]), float(rows[-1, 0])
        self.lengths.append(stop - start)
        if len(self.lengths) in self.fails:
            raise DataError("too little motion", where="stream", fix="move")
        weight = {"mass": 2.0, "mass_half_width": 0.1}
        events = tuple(
            PayloadEvent(t - start, t - start - 0.1, t - start + 0.1, 5.0, kind=kind, **weight)
            for t, kind in KINDS.items()
            if start + 3.0 < t < stop - 3.0
        )
        least = self.least[len(self.lengths) % len(self.least)]
        return PayloadEvents(
            "stream", "tool", "link", events, (), 0.1, 1.0, least, True, (), NO_MASS
        )


def run_of(stream: PayloadStream, seconds: float) -> list[tuple[float, PayloadEvent]]:
    times = np.arange(0.0, seconds, 0.05)
    return [(float(t), e) for t in times for e in stream.step(float(t), np.array([t, 1.0]))]


def test_a_change_is_reported_once_when_it_is_found_twice() -> None:
    search = Search()
    reported = run_of(PayloadStream(search), 120.0)
    assert {round(e.time, 6): e.kind for _, e in reported} == KINDS and len(reported) == 2
    delays = [at - e.time for at, e in reported]
    assert all(3.0 + SEARCH_PERIOD <= delay <= 3.0 + 2.0 * SEARCH_PERIOD + 0.1 for delay in delays)
    assert search.lengths[0] == pytest.approx(FIRST_SEARCH)
    assert max(search.lengths) <= SEARCHED_SPAN + 1e-9


def test_a_search_that_fails_is_no_change_and_is_said() -> None:
    stream = PayloadStream(Search(1, 2))
    assert stream.state is None
    run_of(stream, 13.0)
    assert stream.failed == "too little motion" and stream.searches == 0
    stream = PayloadStream(Search(1))
    assert run_of(stream, 12.5) == []
    assert stream.failed == "" and stream.searches == 1
    assert stream.state is not None and stream.state.mass == 0.0


def test_the_least_visible_mass_is_that_of_half_of_the_searches() -> None:
    stream = PayloadStream(Search())
    assert stream.least_mass is None
    run_of(stream, 30.0)
    assert stream.least_mass == 0.5
    assert stream.state is not None and stream.state.least_mass == 0.5
    mixed = PayloadStream(Search(least=(0.2, 0.3, 1.2)))
    run_of(mixed, 60.0)
    assert mixed.least_mass == 0.3
    blind = PayloadStream(Search(least=(0.5, np.inf, np.inf)))
    run_of(blind, 60.0)
    assert blind.least_mass == np.inf


def test_lasting_residuals_are_doubted_and_a_push_is_not() -> None:
    measured, push = np.array([40.0, 20.0]), np.array([20.0, 0.0])
    doubt = Doubt(np.ones(2))
    for k in range(2000):
        pushed = 400 <= k < 800
        doubt.step(0.01, pushed, push if pushed else 0.1 * push, measured)
    assert doubt.text == ""
    for _ in range(2000):
        doubt.step(0.01, True, 0.5 * push, measured)
    assert doubt.text.startswith("residuals exceed their thresholds in 24 of 40 s: other efforts")
    little = Doubt(np.ones(2))
    for _ in range(600):
        little.step(0.01, False, measured, measured)
    assert little.text.startswith("the model explains 0 % of the squared efforts of 6 s")


def test_a_residual_that_exceeds_for_one_sample_is_no_contact() -> None:
    never = np.full(N, np.nan)
    stream = ContactStream(ROBOT, SIGMA, lasting=0.006)
    found = []
    for k in range(40):
        residual = np.full(N, 0.1)
        residual[1] = 3.0 if k == 10 or 20 <= k < 24 else 0.1
        signal, levels = np.stack([residual, never]), np.stack([np.ones(N), never])
        found += list(stream.step(0.01 * k, signal, levels, (0.01 * k, 0.01 * k), gap=k == 22))
    (start,) = found
    assert isinstance(start, ContactStart) and start.joint.peak == 3.0
    assert (start.time, start.known) == pytest.approx((0.20, 0.21))
