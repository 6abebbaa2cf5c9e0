"""Numbers as people read them; what is not a number never breaks a page."""

import re
from collections.abc import Sequence
from math import floor, isfinite, log10
from typing import Literal

Level = Literal["good", "fair", "poor", "none"]  # `none` if there is nothing to judge by

COLOURS: dict[Level, str] = {"good": "green", "fair": "yellow", "poor": "red", "none": "default"}

NONE = "–"  # stands where there is no number
LEAST_SHARE_PERCENT = 0.1  # share [%] below which it is called none
MOST_RELATIVE_PERCENT = 1000.0  # relative standard deviation [%] beyond which it is not printed

UNIT = re.compile(
    r"(?<=\d) (?=(?:%|°|Hz|kHz|bit|s|ms|µs|min|h|N|Nm|kN|A|mA|V|W|kg|g|m|mm|rad|N ?m)(?![\w]))"
)
"""The space between a number and its unit."""

INTERVAL = re.compile(r" (?=±)|(?<=±) ")  # the spaces between a number and its interval
EXPONENT = re.compile(r"(?<=\de-)(?=\d)")  # where a browser would break a number like 1e-06
SEAM = re.compile(r"(?<=_)|(?<=[A-Za-z]\.)(?=[A-Za-z])")  # where a long name may be broken

ROUND_OFF_OF_ZERO = 1e-13  # size up to which a number is the rounding of a zero, whatever its unit


def significant(value: float | None, digits: int = 3) -> str:
    """A number with so many significant digits, never in the form `1e+03` below a million."""
    if value is None or not isfinite(value):
        return NONE if value is None or value != value else "inf" if value > 0 else "-inf"
    if abs(value) < ROUND_OFF_OF_ZERO:
        return "0"
    if not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}"
    return f"{value:,.{_decimals(value, digits)}f}".replace(",", "\u00a0")


def signed(value: float) -> str:
    """A number with its sign and three digits."""
    return f"{'+' if value > 0.0 else ''}{significant(value)}"


def percent(value: float | None) -> str:
    """A percentage with its sign, like `5.4 %`."""
    text = significant(value, 2 if value is not None and abs(value) < 10.0 else 3)
    return text if text == NONE else f"{text}\u00a0%"


def share(value: float | None) -> str:
    """A share of 100 %; below 0.1 % it is none."""
    return percent(0.0 if value is not None and abs(value) < LEAST_SHARE_PERCENT else value)


def relative(value: float | None) -> str:
    """A relative uncertainty in percent; beyond 1000 % its figures say nothing."""
    if value is not None and value > MOST_RELATIVE_PERCENT:
        return f"> {MOST_RELATIVE_PERCENT:.0f} %".replace(" ", "\u00a0")
    return percent(value)


def fixed(value: float, decimals: int = 3) -> str:
    """A number with so many decimals; a zero has no sign."""
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if isfinite(value) and not float(text) else text


def kept(text: str) -> str:
    """Words in which no line ends inside a number, or between it and its unit or interval."""
    return EXPONENT.sub("\u2060", INTERVAL.sub("\u00a0", UNIT.sub("\u00a0", text)))


def pieces(name: str) -> list[str]:
    """A name cut where a line may end: behind its dots and underscores."""
    return SEAM.split(name)


def rounded_to_uncertainty(value: float, scale: float, digits: int = 2) -> str:
    """A number with the decimals that its uncertainty `scale` has at so many digits."""
    if not (isfinite(value) and isfinite(scale)) or scale <= 0.0:
        return significant(value, 4)
    if not (1e-6 <= scale < 1e6 and abs(value) < 1e9):
        return significant(value, 4)
    return fixed(value, _decimals(scale, digits))


def first_names(names: Sequence[str], most: int) -> str:
    """The first names, and the number of the others."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def with_interval(value: float, half_width: float) -> str:
    """A number with the half-width of its interval, like `2.41 ± 0.13`."""
    return f"{rounded_to_uncertainty(value, half_width)} ± {significant(half_width, 2)}"


def count(number: int, thing: str) -> str:
    """Like `1 joint`, `6 joints`."""
    return f"{number} {thing}" + ("" if number == 1 else "s")


def _decimals(value: float, digits: int) -> int:
    return max(digits - 1 - floor(log10(abs(value))), 0)
