"""What the transient protocol changes against the paper's stepwise one, and the measured displacement beside both."""

import dataclasses
import functools
from collections.abc import Callable, Mapping

import jax.numpy as jnp
import numpy as np
import scipy.optimize
import xarray as xr

from arfjax import (
    DamageEdge,
    DoseSize,
    InputError,
    Model,
    Phase,
    Rung,
    SineIntensity,
    Sonication,
    SonicationResult,
    SteadyShaking,
    StepwiseResult,
    TransientProtocol,
    TransientResult,
    protocol_ladder,
    resolving,
    run_transient,
    sonicate,
    tissues,
)
from arfjax.numerics.compiled import compiled
from arfjax.protocols.discretisation import Discretisation
from inverse.datasets.hmi import HmiData
from inverse.reproduction.bench import Bench
from inverse.reproduction.displacement import percent_of_first
from inverse.reproduction.row import Row

SECTION = "protocols"
LADDER_TEMPERATURES = (35.0, 40.0, 45.0, 50.0, 55.0, 57.5, 60.0, 62.5, 65.0, 67.5, 70.0)
MEASURED_TO = 84.0
"""Highest temperature of the measured displacement [degC]."""

FREQUENCY = 50.0  # Hz
_N_STEPS = 120
_FIELD_TOLERANCE = 2.0  # K
_OVERSHOOT = 0.05  # K; so that the last temperature is surely reached
REFERENCE = 37.0
"""Temperature [degC] to which the measured displacement is normalised."""

_UNIT = "percent of 37 degC"
_MEASURED_WHY = "lesion by dose; another transducer and animal: sonications differ by up to 31 points among themselves"
_WHY = {
    "heating": "the lesion by the dose of a sonication with feedback, which heats slowly first and then faster",
    "local absorption": "each point absorbs at its own temperature, in the pressure of cold tissue",
    "path": "the beam runs through tissue of these temperatures",
    "lesion shape": "the lesion has the dose's shape and every point its own moduli, no ellipsoid with linear edge",
    "shaking": "peak to peak at 50 Hz, whose shear waves are longer than the lesion, instead of a push of 0.5 ms",
    "fractional solid": "table 2's fractional constants instead of table 3's",
}


@dataclasses.dataclass(frozen=True)
class Comparison:
    """The ladder from one protocol to the other, and a sonication watched at 50 Hz.

    Attributes:
        rungs: Displacement at `LADDER_TEMPERATURES`, one cause more on each.
        power: That takes the focus to the paper's last temperature in its 60 s, with feedback [W].
        watched: A sonication at 50 Hz to the highest measured temperature, its lesion shaped by the dose.
        watched_power: Its mean power [W].
    """

    rungs: tuple[Rung, ...]
    power: float
    watched: TransientResult
    watched_power: float

    def curve(self) -> dict[float, float]:
        """Displacement of the watched sonication [percent of 37 degC], by the temperature of its focus [degC]."""
        temperature = np.asarray(self.watched.thermocouple_temperature)
        percent = 100.0 * np.asarray(self.watched.normalised(REFERENCE))
        return dict(zip(temperature.tolist(), percent.tolist(), strict=True))

    def dataset(self) -> xr.Dataset:
        """The ladder as a table: percent of the first temperature, by rung and temperature."""
        values = np.stack([np.asarray(rung.percent()) for rung in self.rungs])
        data = xr.Dataset(
            {"displacement_percent": (("rung", "step_temperature"), values)},
            {"rung": [rung.name for rung in self.rungs], "step_temperature": np.asarray(LADDER_TEMPERATURES)},
        )
        data["displacement_percent"].attrs = {"units": "percent", "long_name": "displacement over that at the first"}
        data["step_temperature"].attrs = {"units": "degC", "long_name": "temperature of the focus"}
        data.attrs = {"acoustic_power_w": self.power}
        return data


def compare_protocols(bench: Bench) -> Comparison:
    """Climbs the ladder on the paper's case; lesion by dose, since the transient protocol follows the dose."""
    model, settings, start = _by_dose(bench.model), bench.coarse, bench.protocol.start_temperature
    shaking = _shaking(model, settings)
    plan = Sonication((Phase(bench.protocol.duration, _N_STEPS),), start, _FIELD_TOLERANCE)
    heat = compiled(lambda model: sonicate(model, plan, settings))
    powers = [
        power_reaching(model, heat, target, guess)
        for target, guess in ((bench.protocol.final_temperature, 17.0), (MEASURED_TO, 20.0))
    ]
    hot = at_power(model, powers[0])
    given = (tissues.fractional_liver_viscoelasticity(), tissues.fractional_lesion_viscoelasticity())
    rungs = compiled(
        lambda model, heated: protocol_ladder(
            model,
            heated,
            plan,
            bench.protocol,
            settings,
            jnp.asarray(LADDER_TEMPERATURES),
            shaking=shaking,
            fractional=given,
        )
    )(hot, heat(hot))
    shaped = dataclasses.replace(model, lesion=dataclasses.replace(model.lesion, edge=DamageEdge()))
    modulated = at_power(shaped, powers[1] / float(shaking.mean_force()))
    protocol = TransientProtocol(plan, shaking)
    watched = compiled(lambda model: run_transient(model, protocol, settings))(modulated)
    return Comparison(rungs, powers[0], watched, powers[1])


def power_reaching(model: Model, heat: Callable[[Model], SonicationResult], target: float, guess: float) -> float:
    """Power [W] with which the focus ends a little above a temperature [degC].

    Args:
        model: The model.
        heat: Sonication of a model.
        target: [degC].
        guess: [W].

    Raises:
        InputError: if no power from a quarter to four times the guess does.
    """

    @functools.cache
    def excess(power: float) -> float:
        return float(heat(at_power(model, power)).focal_temperature[-1]) - target - _OVERSHOOT

    low, high = 0.25 * guess, 4.0 * guess
    if not excess(low) < 0.0 < excess(high):
        raise InputError(f"no power from {low:g} to {high:g} W takes the focus to {target:g} degC in the sonication.")
    found = scipy.optimize.root_scalar(excess, bracket=(low, high), method="brentq", xtol=1e-4 * guess)
    return float(found.root)


def at_power(model: Model, power: float) -> Model:
    """The model with another acoustic power [W]."""
    return dataclasses.replace(model, drive=dataclasses.replace(model.drive, acoustic_power=power))


def comparison_rows(comparison: Comparison) -> list[Row]:
    """What each cause changes of the normalised displacement at 60 and 70 degC; the paper has none of them."""
    rows = []
    for temperature in (60.0, 70.0):
        index = LADDER_TEMPERATURES.index(temperature)
        for before, after in zip(comparison.rungs, comparison.rungs[1:], strict=False):
            change = float(after.percent()[index] - before.percent()[index])
            quantity = f"at {temperature:g} degC, change by: {after.name}"
            rows.append(Row(SECTION, quantity, None, change, "percent points", 0.0, _WHY[after.name]))
    return rows


def measured_rows(measured: HmiData, pushed: StepwiseResult, watched: Mapping[float, float]) -> list[Row]:
    """Measured values against both protocols, interpolated in temperature as far as each goes.

    Args:
        measured: In percent of the displacement at 37 degC.
        pushed: The stepwise protocol, lesion by dose.
        watched: The transient protocol at 50 Hz [percent], by temperature [degC].
    """
    assert measured.temperature is not None
    rows = []
    for label in measured.labels:
        for index in measured.rows_of(label):
            temperature, value = float(measured.temperature[index]), float(measured.displacement[index])
            for name, curve in (("stepwise pushes", percent_of_first(pushed)), ("transient, 50 Hz", watched)):
                at, percent = np.asarray(list(curve)), np.asarray(list(curve.values()))
                if temperature > at[-1] + _OVERSHOOT:
                    continue
                here = 100.0 * float(np.interp(temperature, at, percent) / np.interp(REFERENCE, at, percent))
                quantity = f"sonication {label} at {temperature:g} degC, {name}"
                rows.append(Row("measured displacement", quantity, value, here, _UNIT, 0.5, _MEASURED_WHY))
    return rows


def _by_dose(model: Model) -> Model:
    return dataclasses.replace(model, lesion=dataclasses.replace(model.lesion, size=DoseSize()))


def _shaking(model: Model, settings: Discretisation) -> SteadyShaking:
    given = {"frequency": FREQUENCY, "modulation": SineIntensity()}
    return SteadyShaking(**given, vibration=resolving(model, MEASURED_TO, settings, **given))
