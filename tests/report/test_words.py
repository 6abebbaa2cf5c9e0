import pytest

from steelyard.report.words import (
    count,
    fixed,
    kept,
    percent,
    pieces,
    relative,
    rounded_to_uncertainty,
    share,
    significant,
)


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
        (-1e-9, 0.02, "0.000"),
    ],
)
def test_decimals_follow_the_uncertainty(value, scale, text):
    assert rounded_to_uncertainty(value, scale) == text


def test_plurals():
    assert [count(n, "joint") for n in (0, 1, 6)] == ["0 joints", "1 joint", "6 joints"]


def test_a_share_of_next_to_nothing_is_none():
    assert [share(x) for x in (0.0, 0.0999, 0.11, 81.5, None)] == [
        "0\u00a0%",
        "0\u00a0%",
        "0.11\u00a0%",
        "81.5\u00a0%",
        "–",
    ]


def test_a_huge_relative_uncertainty_is_not_told():
    assert [relative(x) for x in (20.0, 1000.1, float("inf"), float("nan"))] == [
        "20.0\u00a0%",
        ">\u00a01000\u00a0%",
        ">\u00a01000\u00a0%",
        "–",
    ]


def test_a_zero_has_no_sign():
    assert [fixed(x) for x in (-0.0004, -0.0, -0.0006, 1.0)] == [
        "0.000",
        "0.000",
        "-0.001",
        "1.000",
    ]
    assert fixed(float("nan")) == "nan"


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("12 Hz", "12\u00a0Hz"),
        ("8 to 13 ms, jitter 0.95 ms", "8 to 13\u00a0ms, jitter 0.95\u00a0ms"),
        ("46.7 % of it", "46.7\u00a0% of it"),
        ("2 shoulders, 1700 of 3", "2 shoulders, 1700 of 3"),
        ("1e-06 x-07", "1e-\u206006 x-07"),
    ],
)
def test_numbers_keep_their_units(text, wanted):
    assert kept(text) == wanted


def test_names_are_cut_at_dots_and_underscores_alone():
    assert pieces("Iyy.wrist_3_link") == ["Iyy.", "wrist_", "3_", "link"]
    assert pieces("0.4 effort") == ["0.4 effort"]
