"""Windows and periods of the filters of `[processing]` against the length of the log."""

from typing import Any

import numpy as np
import pytest

from steelyard.base.errors import LogError
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import (
    METHODS,
    SMOOTHERS,
    Processing,
    method_of,
    smoother_of,
    window,
)

RATE = 100.0


def test_finite_windows_are_counted_to_the_sample() -> None:
    for name, given in (("moving_average", "span"), ("savitzky_golay", "window")):
        for length in (11, 51, 301):
            assert window(SMOOTHERS[name](**{given: length}).smooth(5.0, RATE), 2) == length
    assert window(METHODS["savitzky_golay"](window=51).designed(5.0, RATE), 2, None) == 51
    assert window(METHODS["butterworth"]().designed(5.0, RATE), 2, None) < 3.0 * RATE / 5.0
    assert window(METHODS["kalman"]().designed(5.0, RATE), 2, None) == 0


@pytest.mark.parametrize(
    ("processing", "wrong", "key"),
    [
        ({"effort": {"method": "moving_average", "span": 1003}}, "1003 samples", "effort"),
        ({"effort": {"method": "savitzky_golay", "window": 1003}}, "1003 samples", "effort"),
        ({"motion": {"method": "moving_average", "span": 1003}}, "10.* s.* but the log", "motion"),
        ({"motion": {"method": "savitzky_golay", "window": 1003}}, "1003 samples", "motion"),
        (
            {"effort": "butterworth", "effort_cutoff": 1e-4},
            "period of 1e\\+04 s",
            "cutoff in effort",
        ),
        ({"effort": "kalman", "effort_cutoff": 1e-4}, "period of 1e\\+04 s", "cutoff in effort"),
        ({"motion_cutoff": 1e-4, "parallel_filter": False}, "period of 1e", "motion_cutoff"),
        ({"motion": {"method": "kalman_filter", "cutoffs": [9.0, 1e-4]}}, "period", "cutoffs in"),
        ({"motion": {"method": "auto", "cutoffs": [9.0, 1e-4]}}, "period", "cutoffs in motion"),
    ],
)
def test_filters_longer_than_the_log_are_refused(
    recording: Any, sines: Any, processing: dict[str, Any], wrong: str, key: str
) -> None:
    t = np.arange(1000) / RATE
    log = recording(t, sines(t)["q"], sines(t)["effort"])
    for name, made in (("motion", method_of), ("effort", smoother_of)):
        if name in processing:
            processing = processing | {name: made(processing[name], "robot file")}
    with pytest.raises(LogError, match=wrong) as caught:
        prepare(log, Processing(**processing))
    assert "10 s without a gap" in caught.value.wrong
    assert caught.value.where == f"{log.where}, {caught.value.where.split(', ')[-1]}"
    assert key in caught.value.where and "log for longer" in caught.value.fix


def test_filters_as_long_as_the_log_are_not(recording: Any, sines: Any) -> None:
    t = np.arange(1000) / RATE
    log = recording(t, sines(t)["q"], sines(t)["effort"])
    longest = method_of({"method": "savitzky_golay", "window": 999}, "")
    smoother = smoother_of({"method": "moving_average", "span": 999}, "")
    assert prepare(log, Processing(motion=longest, effort=smoother)).n_samples > 900
    shorter = recording(t[:210], sines(t)["q"][:210], sines(t)["effort"][:210])
    for name in set(METHODS) - {"fourier"}:
        assert prepare(shorter, Processing(motion=METHODS[name]())).n_samples > 150
