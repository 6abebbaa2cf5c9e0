"""Colours and marks of models in pictures, one after the other."""

from collections.abc import Sequence
from typing import Literal

from steelyard.report.figures import Key

COLOURS = ("--vermillion", "--blue", "--green", "--purple", "--amber", "--arm")
SYMBOLS = ("diamond", "circle", "square", "x", "triangle-up", "cross")
DASHES = ("solid", "dash", "dot", "dashdot")
"""Of lines, changed when the colours begin again."""


def colour(number: int) -> str:
    """Name in the style sheet of a model's colour."""
    return COLOURS[number % len(COLOURS)]


def symbol(number: int) -> str:
    """Of a model's marks."""
    return SYMBOLS[number % len(SYMBOLS)]


def dash(number: int) -> str:
    """Of a model's lines."""
    return DASHES[number // len(COLOURS) % len(DASHES)]


def legend(names: Sequence[str], shape: Literal["line", "point"]) -> list[Key]:
    """Colours of models by name."""
    return [Key(colour(k), name, shape) for k, name in enumerate(names)]
