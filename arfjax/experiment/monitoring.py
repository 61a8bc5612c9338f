"""The section of an experiment file that says how displacement is watched during a sonication."""

from typing import Annotated, Literal

from pydantic import model_validator

from arfjax.experiment.numbers import Celsius, Number, Section, between
from arfjax.instruments.speckle_tracking import SpeckleTracker, single_element_tracker
from arfjax.mechanics.modulation import Modulation, SineIntensity, SinePressure, Square
from arfjax.model import Model
from arfjax.protocols.discretisation import Discretisation
from arfjax.protocols.probing import Probe, ShortPush, SteadyShaking
from arfjax.protocols.vibration import resolving

_SHARE = Annotated[Number, between(0.01, 1.0, "", "it is a share, not percent")]


class TrackingSection(Section):
    """A focused disc that tracks speckle along the beam's axis, or a perfect point."""

    aperture_diameter_mm: Annotated[Number, between(1.0, 200.0, "mm", "give millimetres")] | None = None
    lowest_frequency_mhz: Annotated[Number, between(0.1, 100.0, "MHz", "is it in Hz? Give MHz")] = 5.84
    highest_frequency_mhz: Annotated[Number, between(0.1, 100.0, "MHz", "is it in Hz? Give MHz")] = 8.66
    window_mm: Annotated[Number, between(0.1, 20.0, "mm", "give millimetres")] = 2.0
    radial_offset_mm: Annotated[Number, between(0.0, 5.0, "mm", "give millimetres")] = 0.0
    axial_offset_mm: Annotated[Number, between(-5.0, 5.0, "mm", "give millimetres")] = 0.0

    @model_validator(mode="after")
    def _band_is_one(self) -> "TrackingSection":
        if self.lowest_frequency_mhz >= self.highest_frequency_mhz:
            raise ValueError(
                f"lowest_frequency_mhz {self.lowest_frequency_mhz:g} must be below highest_frequency_mhz "
                f"{self.highest_frequency_mhz:g}; correct one of the two"
            )
        if self.aperture_diameter_mm is None and self.model_fields_set:
            raise ValueError(
                "tracking by a perfect point has no other keys; give aperture_diameter_mm, or leave it out"
            )
        return self

    def tracker(self, depth: float) -> SpeckleTracker:
        """The tracker, focused at a depth [m]."""
        if self.aperture_diameter_mm is None:
            return SpeckleTracker()
        return single_element_tracker(
            aperture_diameter=1e-3 * self.aperture_diameter_mm,
            depth=depth,
            lowest_frequency=1e6 * self.lowest_frequency_mhz,
            highest_frequency=1e6 * self.highest_frequency_mhz,
            window_length=1e-3 * self.window_mm,
            radial_offset=1e-3 * self.radial_offset_mm,
            axial_offset=1e-3 * self.axial_offset_mm,
        )


class MonitoringSection(Section):
    """What moves the tissue while it heats, and what its displacement is normalised to."""

    probe: Literal["shaking", "push"] = "shaking"
    frequency_hz: Annotated[Number, between(5.0, 1000.0, "Hz", "give hertz")] = 50.0
    modulation: Literal["intensity", "pressure", "square"] = "intensity"
    depth: _SHARE = 1.0
    duty_cycle: Annotated[Number, between(0.01, 0.99, "", "it is a share, not percent")] = 0.5
    push_ms: Annotated[Number, between(0.01, 20.0, "ms", "is it in seconds? Give milliseconds")] = 0.5
    tolerance_k: Annotated[Number, between(0.1, 50.0, "K", "give kelvin")] = 2.0
    normalised_at_c: Celsius | None = None
    tracking: TrackingSection = TrackingSection()

    @model_validator(mode="after")
    def _choices_fit(self) -> "MonitoringSection":
        idle = {"push_ms"} if self.probe == "shaking" else {"frequency_hz", "modulation", "depth", "duty_cycle"}
        if self.probe == "shaking":
            idle.add("depth" if self.modulation == "square" else "duty_cycle")
        given = sorted(idle & self.model_fields_set)
        if given:
            kind = self.probe if self.probe == "push" else f"{self.probe}, modulation = {self.modulation}"
            raise ValueError(f"{', '.join(given)} has no effect with probe = {kind}; leave it out")
        return self

    def course(self) -> Modulation:
        """Course of the force over a period."""
        if self.modulation == "square":
            return Square(self.duty_cycle)
        return SineIntensity(self.depth) if self.modulation == "intensity" else SinePressure(self.depth)

    def mean_force(self) -> float:
        """Mean of the force as a share of its largest, and so of the power."""
        return 1.0 if self.probe == "push" else float(self.course().coefficients(0)[0].real)

    def plan(self, model: Model, settings: Discretisation, hottest: float) -> Probe:
        """How tissue is moved, on elements that resolve its waves up to a temperature [degC]; not for `jit`."""
        if self.probe == "push":
            return ShortPush(1e-3 * self.push_ms)
        given = {"frequency": self.frequency_hz, "modulation": self.course()}
        return SteadyShaking(**given, vibration=resolving(model, hottest, settings, **given))

    def words(self) -> str:
        """What moves the tissue."""
        if self.probe == "push":
            return f"a push of {self.push_ms:g} ms"
        kind = f"square, duty cycle {self.duty_cycle:g}"
        if self.modulation != "square":
            kind = f"sine of the {self.modulation}, depth {self.depth:g}"
        return f"steady shaking at {self.frequency_hz:g} Hz ({kind}), peak to peak"
