"""What every section of a config shares."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


def _number(value: object) -> object:
    if isinstance(value, bool):
        raise ValueError("a number is wanted")
    return value


Number = Annotated[float, BeforeValidator(_number)]
Positive = Annotated[float, Field(gt=0.0), BeforeValidator(_number)]
NonNegative = Annotated[float, Field(ge=0.0), BeforeValidator(_number)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0), BeforeValidator(_number)]
Priority = Annotated[int, Field(ge=0, le=99), BeforeValidator(_number)]
Id = Annotated[int, Field(ge=1, le=255), BeforeValidator(_number)]
Vector = tuple[float, float, float]


class Section(BaseModel):
    """No unknown keys, no infinities, no changes after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
