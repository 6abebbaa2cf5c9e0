"""Columns of a log of joints that follow position targets, where no efforts are logged."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError
from steelyard.robot.file.effort_units_and_gears import Locate, one_each
from steelyard.robot.file.sections import SignalsSection
from steelyard.robot.file.signals import (
    check_distinct,
    clock_of_section,
    columns_of,
    position_scales,
)
from steelyard.robot.robot import Coordinate


@dataclass(frozen=True, eq=False)
class TargetSignals:
    """Columns of targets and positions and how to read them, in the order of the coordinates.

    `scale` is in rad or m per logged unit, without signs. `signs` and `zeros` are those stated:
    positions of the model are `sign * scale * logged + zero`; `None` where they are not stated.
    """

    time: str
    time_scale: float
    position: tuple[str, ...]
    target: tuple[str, ...]
    scale: Array
    signs: tuple[float | None, ...]
    zeros: tuple[float | None, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """All columns that are read."""
        return (self.time, *self.position, *self.target)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.position)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "TargetSignals":
        """The signals of `json_values`; `KeyError`, `ValueError` or `TypeError` if damaged."""
        values = {field.name: data[field.name] for field in fields(cls)}
        values["scale"] = frozen(values["scale"], (len(data["position"]),))
        lists = {name: tuple(x) for name, x in values.items() if isinstance(x, list)}
        if any(len(x) != len(data["position"]) for x in lists.values()):
            raise ValueError("the signals' lists differ in length")
        names = (values["time"], *lists["position"], *lists["target"])
        if not all(isinstance(name, str) for name in names):
            raise ValueError("a column's name is no text")
        if not 0.0 < float(values["time_scale"]) < 1e6 or (values["scale"] <= 0.0).any():
            raise ValueError("a unit of the signals cannot be used")
        if not all(sign in (None, 1, -1) for sign in lists["signs"]):
            raise ValueError("a sign is not 1 or -1")
        return cls(**{**values, **lists})


def build_target_signals(
    section: SignalsSection, coordinates: Sequence[Coordinate], locate: Locate
) -> TargetSignals:
    """The signals that a robot file declares for joints whose efforts are not logged."""
    _refuse_unused(section, locate)
    time, time_scale = clock_of_section(section, locate)
    position, target = (
        columns_of(getattr(section, key), coordinates, locate("signals", key))
        for key in ("position", "target")
    )
    named = [("time", (time,)), ("position", position), ("target", target)]
    check_distinct([(("signals", key), columns) for key, columns in named], locate)
    plain = section.model_copy(update={"position_sign": None})
    scale = position_scales(plain, coordinates, locate)
    n = len(coordinates)
    signs = tuple(section.position_sign or (None,) * n)
    given = section.position_offset
    zeros: Sequence[Any] = (None,) * n
    if given is not None:
        zeros = one_each(given, "offsets", coordinates, locate("signals", "position_offset"))
    position_scales(section, coordinates, locate)  # refuses another number of signs
    known = tuple(None if zero == "identify" else zero for zero in zeros)
    return TargetSignals(time, time_scale, position, target, scale, signs, known)


def _refuse_unused(section: SignalsSection, locate: Locate) -> None:
    """What does not go with targets alone is refused, not ignored."""
    for key in ("velocity", "commanded_position", "commanded_velocity"):
        if getattr(section, key) is not None:
            raise ModelError(
                f"{key} is given beside target, but no efforts",
                where=locate("signals", key),
                fix=f"remove {key}: actuators are identified from positions and targets; or add "
                "[signals.effort], if efforts are logged",
            )
    if section.coordinates == "motor":
        raise ModelError(
            "targets are those of motors, and no efforts are given",
            where=locate("signals", "coordinates"),
            fix='actuators are identified at the joints: coordinates = "joint"',
        )
