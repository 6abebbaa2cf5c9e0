"""What a proof returns, and how it is shown."""

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Claim:
    """One claim with its measured value and its bound.

    Attributes:
        name: What is claimed.
        value: What was measured, with its unit.
        bound: What it is compared with.
        holds: Whether it holds.
    """

    name: str
    value: str
    bound: str
    holds: bool


def data_folder() -> Path:
    """The folder with real robots' logs; a proof without its data fails, it does not skip."""
    named = os.environ.get("STEELYARD_DATA")
    if not named or not Path(named).is_dir():
        sys.exit("error: STEELYARD_DATA names no folder with the robots' data")
    return Path(named)


def table(claims: Sequence[Claim]) -> str:
    """One line a claim."""
    width = max(len(claim.name) for claim in claims)
    figures = max(len(claim.value) for claim in claims)
    return "\n".join(
        f"{'holds ' if c.holds else 'MISSED'}  {c.name:<{width}}  {c.value:<{figures}}  {c.bound}"
        for c in claims
    )


def main_of(main: Callable[[], list[Claim]]) -> None:
    """Run one proof by itself."""
    claims = main()
    print(table(claims))
    sys.exit(not all(claim.holds for claim in claims))
