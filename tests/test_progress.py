import pytest

from steelyard.base.progress import Event, Stopped, report_progress, silent


def test_tells_and_goes_on() -> None:
    heard: list[Event] = []
    report_progress(lambda event: heard.append(event) or True, "fit", 2.0, 5.0)
    assert heard == [Event("fit", 2.0, 5.0)]
    report_progress(silent, "fit", 0.0, 0.0)


def test_stops_with_how_far_it_got() -> None:
    with pytest.raises(Stopped, match="stopped during fit, 2 of 5 done"):
        report_progress(lambda event: False, "fit", 2.0, 5.0)
