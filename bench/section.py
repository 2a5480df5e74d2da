"""What every table of an operator's file is made of."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Duty = Annotated[float, Field(ge=0.0, le=1.0)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0)]
Probability = Annotated[float, Field(gt=0.5, lt=1.0)]


class Section(BaseModel):
    """One table of a file: no unknown keys, no change after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True)
