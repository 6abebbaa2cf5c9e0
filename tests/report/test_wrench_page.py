"""What the page and the terminal say of a wrench."""

from dataclasses import replace

import numpy as np
import pytest

from report.inspected import wrench_content
from steelyard.report.wrench_page import WrenchContent, render_wrench

CONTENT = wrench_content()


def changed(**values: object) -> WrenchContent:
    """The content with another estimate."""
    return replace(CONTENT, estimate=replace(CONTENT.estimate, **values))


def test_limits_are_named() -> None:
    unobservable, band, fitted = CONTENT.warnings
    assert unobservable.startswith("not observable from the joint torques of this log: ")
    assert {"force along z", "moment about x", "moment about y"} == set(
        unobservable.partition(": ")[2].partition(".")[0].split("; ")
    )
    assert "hides pushes shorter than 0.1 s" in band and "8 Hz" in band
    assert "was fitted to this log" in fitted


def test_a_direction_that_is_hidden_for_a_while_is_named() -> None:
    data_share = np.where(np.arange(334)[:, None] < 167, 0.9, [0.9, 0.9, 0.9, 0.9, 0.2, 0.9])
    content = changed(
        learned=0.9 * np.eye(6), data_share=data_share, least_data_share=data_share.min(axis=1)
    )
    hidden = content.warnings[0]
    assert "is not observable in 50 % of the log" in hidden and "mostly moment about y" in hidden


def test_a_lasting_force_is_no_push() -> None:
    content = changed(wrench=np.tile([0.0, 0.0, -90.0, 0.0, 0.0, 0.0], (334, 1)))
    assert "differs from zero in 100 % of the log: a payload" in content.warnings[-1]


def test_components_sum_up_the_log() -> None:
    x, _, z, *_ = CONTENT.components
    push = (CONTENT.estimate.t > 5.0) & (CONTENT.estimate.t < 6.0)
    assert (x.peak, x.peak_half_width, x.unit) == (30.0, 2.0, "N")
    assert x.peak_time_s == CONTENT.estimate.t[push][0]
    assert x.rms == pytest.approx(30.0 * np.sqrt(push.mean()))
    assert x.nonzero_share == pytest.approx(push.mean())
    assert (z.peak, z.data_share, z.nonzero_share) == (0.0, 0.0, 0.0)


def test_the_page_is_safe() -> None:
    page = render_wrench(wrench_content("<b>tool</b>"))
    assert "<b>tool</b>" not in page and "&lt;b&gt;tool" in page
