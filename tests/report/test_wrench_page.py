"""What the page and the terminal say of a wrench."""

from dataclasses import replace

import numpy as np
import pytest

from report.inspected import wrench_content
from steelyard.estimate.external.wrench_methods_and_observer_step import Expected
from steelyard.uses.wrench.wrench import ExternalWrench

CONTENT = wrench_content()


def changed(**values: object) -> ExternalWrench:
    """The content with another estimate."""
    return replace(CONTENT, estimate=replace(CONTENT.estimate, **values))


def test_limits_are_named() -> None:
    unobservable, band, fitted = CONTENT.warnings
    assert unobservable.startswith("not observable from the joint torques of this log: ")
    assert {"force along z", "moment about x", "moment about y"} == set(
        name.removesuffix(" (100 % of the log)")
        for name in unobservable.partition(": ")[2].partition(".")[0].split("; ")
    )
    assert "hides pushes shorter than 0.1 s" in band and "8 Hz" in band
    assert "was fitted to this log" in fitted


def test_a_direction_that_is_hidden_for_a_while_is_named() -> None:
    share = np.where(np.arange(334)[:, None] < 167, 0.9, [0.9, 0.9, 0.9, 0.9, 0.2, 0.9])
    values = {"learned": share[:, :, None] * np.eye(6), "least_data_share": share.min(axis=1)}
    hidden = changed(**values).warnings[0]
    assert "is not observable in 50 % of the log" in hidden and "mostly moment about y" in hidden
    assert "intervals there are wide" in hidden
    inverse = changed(**values, method="inverse").warnings[0]
    assert "the inverse multiplies errors there" in inverse and "wide" not in inverse


def test_a_lasting_force_is_no_push() -> None:
    content = changed(wrench=np.tile([0.0, 0.0, -90.0, 0.0, 0.0, 0.0], (334, 1)))
    words = content.warnings[-1]
    assert "differs from zero in 100 % of the log: efforts in other units" in words
    assert "times the expected" not in words
    assert not any("likelier" in warning for warning in CONTENT.warnings)


def test_a_force_far_beyond_the_expected_is_no_push() -> None:
    content = changed(wrench=20.0 * CONTENT.estimate.wrench)
    assert (
        "the largest force is 22 times the expected 30 N: efforts in other units"
        in (content.warnings[-1])
    )
    unsure = replace(content.estimate, force_half_width=np.full(334, 1000.0))
    assert replace(content, estimate=unsure).warnings == CONTENT.warnings


def test_the_headline_states_the_interval_and_whether_a_force_differs_from_zero() -> None:
    found = CONTENT.estimate
    at = found.t[found.t > 5.0][0]
    place = f"at {at:.2f} s of shift (20.0 s)"
    beyond = "along unobservable directions by the expected size"
    sizes = f"33.5 N (95 %: 28.5 to 90.0 N, {beyond})"
    assert CONTENT.headline == f"Largest force on tool0: {sizes} {place}"
    seen = changed(learned=np.tile(0.9 * np.eye(6), (334, 1, 1)))
    assert seen.headline == f"Largest force on tool0: 33.5 N (95 %: 28.5 to 90.0 N) {place}"
    inverse = changed(method="inverse")
    assert "90.0 N, along observable directions alone)" in inverse.headline
    regular = replace(inverse.estimate, condition=np.full(334, 1e4))
    assert "90.0 N) at" in replace(inverse, estimate=regular).headline
    written = CONTENT.to_dict()["largest_force"]
    assert (written["low_N"], written["high_N"]) == (pytest.approx(28.54, abs=0.01), 90.0)
    assert not written["observable"] and seen.to_dict()["largest_force"]["observable"]
    none = changed(force_half_width=np.full(334, 40.0))
    sizes = f"33.5 N (95 %: 0 to 90.0 N, {beyond})"
    words = f"No force on tool0 that differs from zero (95 %); largest estimate {sizes} {place}"
    assert none.headline == words
    assert f"<p>{words}" in none.report().replace("\u00a0", " ")


def test_the_largest_force_is_one_that_differs_from_zero() -> None:
    wrench, half = np.zeros((334, 6)), np.full(334, 5.0)
    wrench[[10, 20, 30], 0] = 100.0, 20.0, -30.0
    half[10] = 200.0
    assert changed(wrench=wrench, force_half_width=half).estimate.largest == 30
    assert changed(wrench=wrench, force_half_width=half + 200.0).estimate.largest == 10


def test_components_that_are_assumed_or_not_observable_have_no_figures() -> None:
    none = "–"
    z, mx = (CONTENT.components[k].row.cells for k in (2, 3))
    assert z == ("force z [N]", none, none, none, "± 59", none, "0 %") and mx[-1] == "10 %"
    content = changed(expected=Expected(30.0, 0.0))
    assert content.components[3].row.cells[1:] == (none, "assumed zero", none, none, none, none)
    assert "assumed zero" not in content.components[0].row.cells
    estimated = changed(expected=Expected(30.0, 0.0), method="inverse").components[3].row.cells
    assert "assumed zero" not in estimated


def test_the_inverse_has_its_own_remark_on_what_is_not_observable() -> None:
    assert "There the estimate stays near zero" in CONTENT.warnings[0]
    words = changed(method="inverse").warnings[0]
    assert "There the inverse multiplies errors" in words and "stays near zero" not in words


def test_rows_that_were_left_out_are_stated_first() -> None:
    content = replace(CONTENT, left_out=("shift: dropped 2 of 1000 rows",))
    assert content.warnings == ("shift: dropped 2 of 1000 rows", *CONTENT.warnings)


def test_components_sum_up_the_log() -> None:
    x, _, z, *_ = CONTENT.components
    push = (CONTENT.estimate.t > 5.0) & (CONTENT.estimate.t < 6.0)
    assert (x.peak, x.peak_half_width, x.unit) == (30.0, 2.0, "N")
    assert x.peak_time_s == CONTENT.estimate.t[push][0]
    assert x.rms == pytest.approx(30.0 * np.sqrt(push.mean()))
    assert x.nonzero_share == pytest.approx(push.mean())
    assert (z.peak, z.data_share, z.nonzero_share) == (0.0, 0.0, 0.0)


def test_the_page_is_safe() -> None:
    page = wrench_content("<b>tool</b>").report()
    assert "<b>tool</b>" not in page and "&lt;b&gt;tool" in page
