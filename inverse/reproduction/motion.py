"""Measured HMI values beside both protocols: the paper's single pushes, and steady motion at 50 Hz as HMI sees it."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from arfjax import (
    DoseSize,
    Heating,
    Model,
    SineIntensity,
    StepwiseProtocol,
    StepwiseResult,
    VibrationSettings,
    resolving,
    vibrate,
)
from arfjax.protocols.discretisation import Discretisation
from inverse.datasets.hmi import HmiData
from inverse.reproduction.displacement import percent_of_first
from inverse.reproduction.row import Row

SECTION = "measured displacement"
FREQUENCY = 50.0
"""Of the paper's modulation [Hz]."""

REFERENCE = 37.0
"""Temperature [degC] to which the measured displacement is normalised."""


def vibration_percent(
    model: Model,
    protocol: StepwiseProtocol,
    settings: Discretisation,
    heating: Heating,
    temperatures: tuple[float, ...],
) -> dict[float, float]:
    """Peak-to-peak displacement at 50 Hz in percent of that at the first temperature, by temperature [degC].

    Lesion by dose, linear edge, intensity modulated as a sine: the paper does not state its modulation's depth or form.
    Transducer and layers are those of the paper's simulation, not of its measurement (4.755 MHz).
    """
    model = dataclasses.replace(model, lesion=dataclasses.replace(model.lesion, size=DoseSize()))
    modulation = SineIntensity()
    chosen: VibrationSettings = resolving(model, temperatures[0], settings, frequency=FREQUENCY, modulation=modulation)

    @jax.jit
    def peak_to_peak(temperature: jax.Array) -> jax.Array:
        return vibrate(
            model,
            temperature,
            protocol,
            settings,
            heating=heating,
            frequency=FREQUENCY,
            modulation=modulation,
            vibration=chosen,
        ).peak_to_peak

    values = [float(peak_to_peak(jnp.asarray(temperature))) for temperature in temperatures]
    return {t: 100.0 * value / values[0] for t, value in zip(temperatures, values, strict=True)}


def measured_rows(measured: HmiData, pushed: StepwiseResult, vibrated: dict[float, float]) -> list[Row]:
    """Measured values up to the end of the protocol against both simulated curves, interpolated in temperature.

    Args:
        measured: In percent of the displacement at 37 degC.
        pushed: The stepwise protocol, lesion by dose.
        vibrated: Peak-to-peak displacement [percent of the first], by temperature [degC].
    """
    assert measured.temperature is not None
    curves = {"push": percent_of_first(pushed), "50 Hz": vibrated}
    rows, highest = [], float(pushed.temperature[-1])
    spread = float(np.ptp(measured.displacement[np.isclose(measured.temperature, highest)]))
    for label in measured.labels:
        for index in measured.rows_of(label):
            temperature, value = float(measured.temperature[index]), float(measured.displacement[index])
            if temperature > highest:
                continue
            for name, curve in curves.items():
                at, here = np.asarray(list(curve)), np.asarray(list(curve.values()))
                percent = 100.0 * float(np.interp(temperature, at, here) / np.interp(REFERENCE, at, here))
                quantity = f"sonication {label} at {temperature:g} degC, simulated {name}"
                why = (
                    f"lesion by dose, another transducer and animal; at {highest:g} degC sonications differ by "
                    f"{spread:g} points among themselves"
                )
                rows.append(Row(SECTION, quantity, value, percent, "percent of 37 degC", 0.5, why))
    return rows
