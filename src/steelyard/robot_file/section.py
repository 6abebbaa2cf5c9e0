"""What all tables of the robot file share, as pydantic checks them."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0.0)]
Name = Annotated[str, Field(min_length=1)]
Vector = Annotated[tuple[float, float, float], Field(strict=False)]
Names = Annotated[tuple[Name, ...], Field(strict=False)]
Numbers = Annotated[tuple[float, ...], Field(strict=False)]


ADVICE = "advice"
"""Type of an error of a check whose message is the whole advice."""


class Section(BaseModel):
    """A table of the robot file: no unknown keys, no silent conversions."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)
