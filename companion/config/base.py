"""What every section of a config shares."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo

from companion.config.numbers import kept


def _number(value: object) -> object:
    if isinstance(value, bool | str):  # a number in quotes has not been looked at by the loader
        raise ValueError("a number is wanted")
    if isinstance(value, int) and not kept(value):
        raise ValueError("it has more digits than are kept")
    return value


def _beside_the_config(path: Path, info: ValidationInfo) -> Path:
    folder = (info.context or {}).get("folder", Path())
    return Path(folder / path.expanduser()).absolute()


NUMBER: Final = BeforeValidator(_number)
"""Behind a `Field` with bounds, which the documentation would not find before it."""

Number = Annotated[float, NUMBER]
Positive = Annotated[float, Field(gt=0.0), NUMBER]
NonNegative = Annotated[float, Field(ge=0.0), NUMBER]
Fraction = Annotated[float, Field(ge=0.0, le=1.0), NUMBER]
Priority = Annotated[int, Field(ge=0, le=99), NUMBER]
Id = Annotated[int, Field(ge=1, le=255), NUMBER]
FileBesideConfig = Annotated[Path, AfterValidator(_beside_the_config)]
Vector = tuple[Number, Number, Number]


class Section(BaseModel):
    """No unknown keys, no infinities, no changes after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
