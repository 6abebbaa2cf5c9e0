"""Tables with the name of a kind: one reader for terms, processing methods and knowledge."""

from dataclasses import dataclass
from typing import Any, ClassVar

import pytest

from steelyard.base.errors import ModelError
from steelyard.estimate.prior.prior_constraint_kinds import KINDS as KNOWLEDGE
from steelyard.model.laws.register import term_of
from steelyard.robot.file.tables_by_kind import Kinds
from steelyard.runs.processing_choices import method_of


@dataclass(frozen=True)
class Ball:
    """A ball."""

    shape: ClassVar[str] = "ball"
    radius: float
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tags: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.radius <= 0.0:
            raise ModelError(f"a radius of {self.radius:g}", where="ball", fix="give one above 0")


@dataclass(frozen=True)
class Point:
    """A point."""

    shape: ClassVar[str] = "point"


SHAPES = Kinds({"ball": Ball, "point": Point}, "shape", "shape of a body", "shape")


def test_a_name_or_a_table_makes_the_value() -> None:
    assert SHAPES.built("point", "here") == Point()
    table = {"shape": "ball", "radius": 2.0, "centre": [1.0, 2.0, 3.0], "tags": ["a"]}
    assert SHAPES.built(table, "here") == Ball(2.0, (1.0, 2.0, 3.0), ("a",))
    assert list(table) == ["shape", "radius", "centre", "tags"]


@pytest.mark.parametrize(
    ("given", "wrong", "fix"),
    [
        ({"radius": 1.0}, "the table does not name its shape", "the shapes are ball, point"),
        ("bal", "'bal' is no shape of a body", "did you mean 'ball'?"),
        ({"shape": 3}, "'3' is no shape of a body", "the shapes are ball, point"),
        ({"shape": "ball", "radus": 1.0}, "shape 'ball' does not understand 'radus'", "'radius'"),
        ({"shape": "point", "radius": 1.0}, "does not understand 'radius'", "no keys there"),
        ({"shape": "ball"}, "shape 'ball' needs 'radius'", "add radius = ..."),
        ({"shape": "ball", "radius": "1"}, "'1' cannot be used for 'radius'", "number"),
        ({"shape": "ball", "radius": -1.0}, "a radius of -1", "give one above 0"),
    ],
)
def test_mistakes_are_reported_where_they_stand(given: Any, wrong: str, fix: str) -> None:
    with pytest.raises(ModelError) as caught:
        SHAPES.built(given, "arm.toml, line 3")
    assert wrong in caught.value.wrong and fix in caught.value.fix
    assert caught.value.where == "arm.toml, line 3"


@pytest.mark.parametrize(
    ("reader", "table", "fix"),
    [
        (term_of, {"law": "viscos"}, "did you mean 'viscous'"),
        (term_of, {"law": "stribeck", "sped": 0.1}, "'speed'"),
        (method_of, {"method": "butterworth", "ordr": 3}, "'order'"),
        (KNOWLEDGE.built, {"kind": "total_mas"}, "'total_mass'"),
    ],
)
def test_all_of_them_name_what_is_near(reader: Any, table: dict[str, Any], fix: str) -> None:
    with pytest.raises(ModelError) as caught:
        reader(table, "arm.toml, line 3")
    assert fix in caught.value.fix and caught.value.where == "arm.toml, line 3"
