"""Parts of a log: all samples once, each with the rows that it depends on."""

from itertools import pairwise

import numpy as np
import pytest

from steelyard.runs.processing_chain import SAMPLES_OF_PART, ToClock, windows
from steelyard.runs.recording import Channels
from steelyard.runs.rows.bridged_rows_segments_and_quality import RowChecks, Segment
from steelyard.runs.rows.clock_and_row_scan import RowPiece
from steelyard.runs.rows.resampling import Interpolation, Lane

RATE = 100.0
SEGMENTS = (Segment(0, 1.0, 301.0, 30_001), Segment(3, 310.0, 310.5, 51))
IDLE = RowChecks(Channels(1, False), *np.full((4, 1), np.nan), threshold=None, bridge_stale=False)
THREE_ROWS = Interpolation(2, lambda t, x, at: x)
CLOCK = ToClock(
    IDLE, RATE, [Lane(slice(k, k + 1), THREE_ROWS, x) for k, x in ((0, 0.2), (1, -0.1))]
)


@pytest.mark.parametrize("samples", [0, 40, 5000])
def test_parts_hold_every_sample_once(samples: int) -> None:
    parts = CLOCK.parts(SEGMENTS, samples)
    for segment in SEGMENTS:
        own = [p for p in parts if p.segment is segment]
        assert own[0].first == 0 and own[-1].stop == segment.samples
        assert all(a.stop == b.first and a.end == b.begin for a, b in pairwise(own))
        assert own[0].since == -np.inf and own[-1].until == np.inf
    if samples == 40:
        middle = parts[1]
        assert middle.since == pytest.approx(1.0 + (SAMPLES_OF_PART - 40) / RATE - 0.1)
        assert middle.until == pytest.approx(1.0 + (2 * SAMPLES_OF_PART - 1 + 40) / RATE + 0.2)


def test_windows_are_the_rows_between_the_times_and_those_around() -> None:
    t = np.arange(1.0, 301.0, 0.005)
    x = np.column_stack((t, -t))
    cuts = np.arange(777, len(t), 777)
    pieces = [RowPiece(0, a, b) for a, b in zip(np.split(t, cuts), np.split(x, cuts), strict=True)]
    other = [RowPiece(1, np.array([302.0]), np.zeros((1, 2)))]
    parts = CLOCK.parts(SEGMENTS[:1], 40)
    found = list(windows([*pieces, *other], parts))
    assert [w.part for w in found] == parts
    for window in found:
        first = max(0, int(np.searchsorted(t, window.part.since, "right")) - 4)
        stop = min(len(t), int(np.searchsorted(t, window.part.until)) + 4)
        np.testing.assert_array_equal(window.t, t[first:stop])
        np.testing.assert_array_equal(window.x, x[first:stop])
    assert found[0].lacking == (4, 0) and found[-1].lacking == (0, 4)
    assert found[1].lacking == (0, 0)
