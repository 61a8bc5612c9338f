"""Numbers of experiment files: strict, finite, and refused where their size betrays another unit."""

from typing import Annotated

from pydantic import AfterValidator, AllowInfNan, BaseModel, ConfigDict, Strict


def between(low: float, high: float, unit: str, mistaken: str) -> AfterValidator:
    """A check by magnitude, with bounds far outside what a focused-ultrasound experiment can have."""

    def check(value: float) -> float:
        if not low <= value <= high:
            expected = f"expected {low:g} to {high:g}{unit and ' '}{unit}, got {value:g}"
            raise ValueError(f"{expected}; {mistaken}" if value > 0.0 else f"{expected}; correct the number")
        return value

    return AfterValidator(check)


Number = Annotated[float, Strict(), AllowInfNan(False)]
Millimetres = Annotated[Number, between(0.2, 1000.0, "mm", "is it in metres? Give millimetres")]
Celsius = Annotated[Number, between(0.0, 120.0, "degC", "is it in kelvin? Subtract 273.15")]


class Section(BaseModel):
    """A section whose unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)
