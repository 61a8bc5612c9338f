"""The section of an experiment file that says how one sonication goes."""

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from arfjax.experiment.numbers import Celsius, Number, Section, between
from arfjax.instruments.thermocouple import Thermocouple
from arfjax.protocols.sonication import Sonication
from arfjax.thermal.bioheat import Phase

_MOST_STEPS = 5000  # more maps of temperature, dose and heat than that fill the memory


class SonicationPhase(Section):
    """A stretch of time at one power."""

    duration_s: Annotated[Number, between(0.01, 3600.0, "s", "is it in milliseconds? Give seconds")]
    relative_power: Annotated[Number, between(0.0, 10.0, "", "1 is the sonication's power, 0 lets cool")] = 1.0


class ThermocoupleSection(Section):
    """A thermocouple at the geometric focus, or what it takes for it."""

    radial_offset_mm: Annotated[Number, between(0.0, 5.0, "mm", "give millimetres")] = 0.0
    axial_offset_mm: Annotated[Number, between(-5.0, 5.0, "mm", "give millimetres")] = 0.0
    junction_diameter_mm: Annotated[Number, between(0.0, 3.0, "mm", "give millimetres")] = 0.0
    time_constant_s: Annotated[Number, between(0.0, 60.0, "s", "is it in milliseconds? Give seconds")] = 0.0
    viscous_fraction: Annotated[Number, between(0.0, 10.0, "", "it is a share of the absorbed power, not percent")] = (
        0.0
    )
    viscous_time_constant_s: Annotated[Number, between(0.0, 60.0, "s", "give seconds")] = 0.0

    @model_validator(mode="after")
    def _artefact_can_last(self) -> "ThermocoupleSection":
        if self.viscous_fraction > 0.0 and self.viscous_time_constant_s == 0.0:
            raise ValueError(
                f"viscous_fraction {self.viscous_fraction:g} has no effect at viscous_time_constant_s 0; give the time "
                "with which the artefact drains, or no fraction"
            )
        if self.viscous_fraction == 0.0 and self.viscous_time_constant_s > 0.0:
            raise ValueError(
                f"viscous_time_constant_s {self.viscous_time_constant_s:g} has no effect without viscous_fraction; "
                "give the share of the absorbed power that heats the thermocouple, or no time constant"
            )
        return self

    def instrument(self) -> Thermocouple:
        """The thermocouple."""
        return Thermocouple(
            radial_offset=1e-3 * self.radial_offset_mm,
            axial_offset=1e-3 * self.axial_offset_mm,
            junction_diameter=1e-3 * self.junction_diameter_mm,
            time_constant=self.time_constant_s,
            viscous_fraction=self.viscous_fraction,
            viscous_time_constant=self.viscous_time_constant_s,
        )


class SonicationSection(Section):
    """One sonication with feedback, as `arfjax sonicate` runs it; without a power that of the transducer."""

    acoustic_power_w: Annotated[Number, between(1e-3, 1e4, "W", "give watts")] | None = None
    start_temperature_c: Celsius = 37.0
    phases: list[SonicationPhase] = Field(
        default=[SonicationPhase(duration_s=60.0), SonicationPhase(duration_s=60.0, relative_power=0.0)], min_length=1
    )
    step_s: Annotated[Number, between(1e-3, 60.0, "s", "is it in milliseconds? Give seconds")] = 0.5
    steps: Literal["fixed", "adaptive"] = "fixed"
    field: Literal["updated", "frozen"] = "updated"
    field_tolerance_k: Annotated[Number, between(0.1, 50.0, "K", "give kelvin")] = 2.0
    thermocouple: ThermocoupleSection = ThermocoupleSection()

    @model_validator(mode="after")
    def _something_heats(self) -> "SonicationSection":
        if all(phase.relative_power == 0.0 for phase in self.phases):
            raise ValueError("no phase has a relative_power above 0, so nothing is heated; leave it out or give 1")
        return self

    @model_validator(mode="after")
    def _steps_can_be_kept(self) -> "SonicationSection":
        n_steps = sum(phase.n_steps for phase in self.phase_list())
        if n_steps > _MOST_STEPS:
            raise ValueError(
                f"{n_steps} steps of step_s {self.step_s:g} are too many to keep; up to {_MOST_STEPS} can be, so "
                "lengthen step_s"
            )
        return self

    @property
    def duration_s(self) -> float:
        """Of all phases."""
        return sum(each.duration_s for each in self.phases)

    def phase_list(self) -> tuple[Phase, ...]:
        """The phases, in steps of at most `step_s`."""
        return tuple(
            Phase(each.duration_s, max(math.ceil(each.duration_s / self.step_s - 1e-9), 1), each.relative_power)
            for each in self.phases
        )

    def plan(self) -> Sonication:
        """What is done to the tissue."""
        tolerance = self.field_tolerance_k if self.field == "updated" else math.inf
        return Sonication(self.phase_list(), self.start_temperature_c, tolerance)
