"""What every section of a configuration is made of."""

from __future__ import annotations

from typing import Annotated, Any, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from common.system.steady_time import LONGEST_WAIT

Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Positive = Annotated[float, Field(gt=0.0)]
# Metres: more than any world has, and little enough to be counted in cells.
Length = Annotated[float, Field(gt=0.0, le=1e6)]

Seconds = Annotated[float, Field(gt=0.0, le=LONGEST_WAIT)]


class Section(BaseModel):
    """Base of all sections: unknown names are errors, values never change after validation."""

    # No process validates all sections, and building the validator of one takes milliseconds.
    model_config = ConfigDict(
        extra="forbid", frozen=True, use_attribute_docstrings=True, allow_inf_nan=False, defer_build=True
    )

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth_for_numbers(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse true and false where a number is wanted, which Python would count as 1 and 0."""
        inner = value if isinstance(value, (list, tuple)) else (value,)
        if any(isinstance(each, bool) for each in inner) and info.field_name is not None:
            kinds = set(_kinds(cls.model_fields[info.field_name].annotation))
            if kinds & {int, float} and not kinds & {bool, Any, object}:
                raise ValueError("input should be a number, and not true or false")
        return value


def _kinds(annotation: Any) -> list[Any]:
    """Return the types that an annotation is made of."""
    parts = [part for part in get_args(annotation) if isinstance(part, type) or get_args(part) or part is Any]
    return [annotation, *(kind for part in parts for kind in _kinds(part))]
