import pytest

from steelyard.report.words import alike, count, percent, significant


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (float("nan"), "–"),
        (float("inf"), "inf"),
        (-float("inf"), "-inf"),
        (0.0, "0"),
        (5.432, "5.43"),
        (-0.012345, "-0.0123"),
        (812.4, "812"),
        (41234.0, "41\u00a0234"),
        (3.2e8, "3.20e+08"),
        (1e-7, "1.00e-07"),
    ],
)
def test_significant_digits(value, text):
    assert significant(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(5.43, "5.4\u00a0%"), (15.93, "15.9\u00a0%"), (None, "–"), (float("inf"), "inf\u00a0%")],
)
def test_percentages(value, text):
    assert percent(value) == text


@pytest.mark.parametrize(
    ("value", "scale", "text"),
    [
        (1.23456, 0.0123, "1.235"),
        (1.23456, 4.0, "1.2"),
        (1.23456, 0.0, "1.235"),
        (1.23456, float("nan"), "1.235"),
        (float("nan"), 1.0, "–"),
        (1.23456e-9, 1e-10, "1.235e-09"),
        (1.5e12, 0.1, "1.500e+12"),
    ],
)
def test_decimals_follow_the_uncertainty(value, scale, text):
    assert alike(value, scale) == text


def test_plurals():
    assert [count(n, "joint") for n in (0, 1, 6)] == ["0 joints", "1 joint", "6 joints"]
