"""Dynamic mechanical analysis in an inference: what sweeps should show, and problems of sweeps alone.

Data are the logarithm of the modulus and, where it was measured, its phase [rad]: scatter that is a fraction of the
modulus is then the same number for all of them, and the phase has the same one.
"""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax import FractionalZener, InputError, Model, complex_modulus
from arfjax.media import Scalar, Solid
from inverse.datasets.dma import Sweep
from inverse.dma_fit import FRACTIONAL
from inverse.dma_residuals import LogModulus
from inverse.inference.noise import NoiseModel, Series
from inverse.inference.parameter_set import Entry, ParameterSet, Varying, parameter
from inverse.inference.problem import Measurement, Problem
from inverse.inference.sonications import Sonications
from inverse.parameters import Parameter
from inverse.priors import ASSUMED, LogNormal, LogUniform, Prior, Uniform

SolidAt = Callable[[Any, int, Scalar], Solid]
"""The solid of a model for the sweep of a number at a temperature [degC]."""

FIRST_DEVIATION = 0.02
"""Scatter of the logarithm of a modulus from which an estimate of it starts."""

_COORDINATES = LogModulus()


class ZenerConstants(eqx.Module):
    """A fractional Zener solid in numbers that no bound ties together.

    Attributes:
        relaxed_modulus: [Pa].
        branch_modulus: Unrelaxed minus relaxed modulus [Pa].
        relaxation_time: [s].
        fractional_order: 1 is the conventional solid [1].
    """

    relaxed_modulus: Scalar
    branch_modulus: Scalar
    relaxation_time: Scalar
    fractional_order: Scalar = 1.0

    @property
    def solid(self) -> FractionalZener:
        """The solid."""
        unrelaxed = self.relaxed_modulus + self.branch_modulus
        return FractionalZener(self.relaxed_modulus, unrelaxed, self.relaxation_time, self.fractional_order)


class Samples(eqx.Module):
    """A solid for every sweep.

    Attributes:
        solids: One a sweep, in the sweeps' order.
    """

    solids: tuple[ZenerConstants, ...]


def of_samples(model: Samples, sweep: int, temperature: Scalar) -> Solid:
    """The solid of a sweep."""
    return model.solids[sweep].solid


def of_liver(model: Model | Sonications, sweep: int, temperature: Scalar) -> Solid:
    """Liver at the sweep's temperature [degC]: what DMA and HMI of one organ share."""
    law = model.liver.viscoelasticity
    if law is None:
        raise InputError("the model's liver has no viscoelastic constants, which sweeps could inform.")
    return law(temperature)


class SweepPrediction(eqx.Module):
    """What sweeps should show: all log moduli, then all phases [rad] where they were measured.

    Attributes:
        angular_frequencies: Of each sweep [rad/s].
        temperatures: Of each sweep [degC].
        solid_at: Finds the solid in the model.
        has_phase: Whether phases were measured.
    """

    angular_frequencies: tuple[Float[Array, " _point"], ...]
    temperatures: tuple[Float[Array, ""], ...]
    solid_at: SolidAt = eqx.field(static=True)
    has_phase: bool = eqx.field(static=True)

    def __call__(self, model: Any) -> Float[Array, " n"]:
        """For every datum."""
        moduli = [
            complex_modulus(self.solid_at(model, index, temperature), omega)
            for index, (omega, temperature) in enumerate(zip(self.angular_frequencies, self.temperatures, strict=True))
        ]
        both = jnp.concatenate([_COORDINATES.coordinates(modulus, self.has_phase) for modulus in moduli])
        return jnp.concatenate([both[:, 0], both[:, 1]]) if self.has_phase else both[:, 0]


def dma_measurement(
    sweeps: Sequence[Sweep],
    solid_at: SolidAt,
    *,
    noise: NoiseModel | None = None,
    name: str = "dma",
) -> Measurement:
    """Sweeps as a measurement of a model: all log moduli, then all phases where they were measured.

    Args:
        sweeps: From `group_sweeps`, all with phase or all without.
        solid_at: Finds the solid in the model.
        noise: How the data scatter; if not given, by the deviations of the file or else by `FIRST_DEVIATION`.
        name: Of the measurement.

    Raises:
        InputError: if some sweeps have a phase and some have not.
    """
    phases = {sweep.data.has_phase for sweep in sweeps}
    if len(phases) != 1:
        raise InputError("some sweeps have storage and loss modulus and some only a magnitude: split the file in two.")
    has_phase = phases.pop()
    lengths = [len(sweep.data) for sweep in sweeps]
    predict = SweepPrediction(
        tuple(jnp.asarray(2.0 * np.pi * sweep.data.frequency_hz) for sweep in sweeps),
        tuple(jnp.asarray(sweep.temperature_c) for sweep in sweeps),
        solid_at,
        has_phase,
    )
    observed = np.concatenate([_COORDINATES.observations(s.data, len(s.data)).observed for s in sweeps])
    measured = np.concatenate([observed[:, 0], observed[:, 1]]) if has_phase else observed[:, 0]
    frequency = np.concatenate([sweep.data.frequency_hz for sweep in sweeps])
    copies = 2 if has_phase else 1
    return Measurement(
        name,
        predict,
        jnp.asarray(measured),
        _along_frequency(np.tile(frequency, copies), lengths * copies),
        _noise_of(sweeps, has_phase) if noise is None else noise,
        "1",
    )


def dma_problem(
    sweeps: Sequence[Sweep],
    *,
    fractional: bool = True,
    with_priors: bool = True,
    estimate_noise: bool = True,
    across: str | None = None,
) -> Problem:
    """Zener solids of sweeps, with wide priors: a solid for each sweep.

    Args:
        sweeps: From `group_sweeps`.
        fractional: Whether the order is free; otherwise it is 1.
        with_priors: Wide priors about the size of the data, or none at all.
        estimate_noise: Whether the deviation of the logarithms is a parameter, too; where the file states deviations,
            a factor on them all.
        across: What sweeps differ by, such as "sample", if each constant is drawn from a population common to all of
            them (see `Varying`); None for solids that know nothing of one another.
    """
    solids, entries, free = [], [], list[Entry]()
    for index, sweep in enumerate(sweeps):
        lowest, highest, middle = _sizes(sweep)
        solids.append(ZenerConstants(0.5 * lowest, highest, middle, 0.5 if fractional else 1.0))
        entries.append(_constants(sweep, index, sweeps, fractional, with_priors))
    if across is not None:
        samples = [sweep.sample for sweep in sweeps]
        once = across == "sample" and all(samples) and len(set(samples)) == len(samples)
        labels = tuple(samples if once else [sweep.label for sweep in sweeps])
        free += [_population(constants, labels, across) for constants in zip(*entries, strict=True)]
    else:
        free += [entry for constants in entries for entry in constants]
    measurement = dma_measurement(sweeps, of_samples)
    if estimate_noise:
        free.append(_noise_parameter(measurement.noise, with_priors))
    return Problem(ParameterSet(tuple(free)), Samples(tuple(solids)), (measurement,))


def _noise_parameter(noise: NoiseModel, with_priors: bool) -> Entry:
    """The size of the noise: of what the file states a factor, as in `fit-dma`, without that one deviation for all."""
    if noise.known is None:
        name, place, sizes = "noise", "noise.dma.additive", (1e-5, 1.0)
    else:
        name, place, sizes = "noise_scale", "noise.dma.scale", (1e-2, 1e2)
    prior = LogUniform(*sizes, source=ASSUMED)
    return parameter(name, place, "1", prior if with_priors else None, transform=prior.transform)


def _sizes(sweep: Sweep) -> tuple[float, float, float]:
    magnitude, omega = sweep.data.modulus_magnitude, 2.0 * np.pi * sweep.data.frequency_hz
    return float(magnitude.min()), float(magnitude.max()), float(np.exp(-np.mean(np.log(omega))))


def _constants(
    sweep: Sweep, index: int, sweeps: Sequence[Sweep], fractional: bool, with_priors: bool
) -> tuple[Entry, ...]:
    lowest, highest, _ = _sizes(sweep)
    moved = FRACTIONAL.parameters(sweep.data)
    omega = 2.0 * np.pi * sweep.data.frequency_hz
    # A relaxation far outside the window of the frequencies looks like a spring: a factor of 1000 is far enough.
    window = LogUniform(float(1e-3 / omega.max()), float(1e3 / omega.min()), source=ASSUMED)
    priors: tuple[Prior, ...] = (
        LogNormal(lowest, 3.0, source=ASSUMED),
        LogNormal(highest, 2.0, source=ASSUMED),
        window,
        Uniform(0.0, 1.0, source="every order that the fractional derivative can have"),
    )
    ending = "" if len(sweeps) == 1 else f"_{index}"
    return tuple(
        parameter(
            f"{each.name}{ending}",
            f"model.solids[{index}].{each.name}",
            each.unit,
            prior if with_priors else None,
            transform=None if with_priors else each.transform,
            label=each.label,
        )
        for each, prior in list(zip(moved, priors, strict=True))[: 4 if fractional else 3]
    )


def _population(constants: Sequence[Entry], labels: tuple[str, ...], across: str) -> Varying:
    first = constants[0].parameter
    name, place = first.name.removesuffix("_0"), first.place.replace("[0]", "[{group}]", 1)
    return Varying(Parameter(name, first.unit, first.transform, first.label, first.prior, place), labels, across)


def _noise_of(sweeps: Sequence[Sweep], has_phase: bool) -> NoiseModel:
    deviations = [_COORDINATES.standard_deviations(sweep.data) for sweep in sweeps]
    if any(each is None for each in deviations):
        return NoiseModel(additive=FIRST_DEVIATION)
    both = np.concatenate([each for each in deviations if each is not None])
    return NoiseModel(known=jnp.asarray(np.concatenate([both[:, 0], both[:, 1]]) if has_phase else both[:, 0]))


def _along_frequency(frequency: Float[np.ndarray, " n"], lengths: Sequence[int]) -> Series:
    starts = np.cumsum([0, *lengths[:-1]])
    previous = np.arange(len(frequency)) - 1
    previous[starts] = -1
    count = len(frequency)
    return Series(frequency, previous, np.ones(count), np.zeros(count, dtype=int), 1)
