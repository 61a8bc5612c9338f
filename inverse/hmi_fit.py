"""Calibration of attenuation and lesion constants to HMI data: the most probable constants and their uncertainty.

Few HMI curves can fix five coefficients of attenuation and three constants of the lesion, so every constant has a
prior, log-normal about the model's own value, with a spread that the experiment file states. The fit works on z, the
constants' logarithms in prior standard deviations, and minimises

    sum ((simulated - measured) / s)^2 + sum z^2

by Levenberg-Marquardt with the exact Jacobian of the whole simulation chain. Where the data come without standard
deviations, s is estimated with them: s^2 = (sum of squared differences) / (n - g), where g, the number of constants
that the data determine, is the sum over constants of 1 minus the posterior variance of z (D. MacKay, Neural
Computation 4 (1992) 415). Errors are those of the linearised posterior.
"""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from pydantic import BaseModel, ConfigDict, Field, model_validator

from arfjax import Discretisation, Exponential, InputError, Linear, Model, NormalisedPolynomial, StepwiseProtocol
from inverse.datasets.hmi import HmiData
from inverse.hmi_model import plan_sweeps, predict
from inverse.least_squares import Descent, descend
from inverse.parameters import Parameter, Positive, constrain
from inverse.uncertainty import delta_method

INFORMED_BELOW = 0.9
"""Posterior over prior standard deviation above which a constant counts as not fixed by the data."""

_NOISE_TOLERANCE = 0.01
_MOST_NOISE_UPDATES = 8
_FIRST_NOISE_PERCENT = 5.0


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class AttenuationPrior(_Section):
    """Attenuation is fitted as its values at five temperatures, which make the five coefficients."""

    anchor_temperatures_c: tuple[float, float, float, float, float] = (35.0, 45.0, 55.0, 65.0, 84.0)
    relative_sd: float = Field(0.25, gt=0.0, le=2.0)

    @model_validator(mode="after")
    def _anchors_differ(self) -> "AttenuationPrior":
        if any(b - a < 1.0 for a, b in zip(self.anchor_temperatures_c, self.anchor_temperatures_c[1:], strict=False)):
            raise ValueError(f"anchor_temperatures_c must rise by 1 K or more, got {self.anchor_temperatures_c}")
        return self


class LesionPrior(_Section):
    """Spread of the lesion's constants about the model's."""

    branch_modulus_relative_sd: float = Field(0.5, gt=0.0, le=3.0)
    branch_modulus_rate_relative_sd: float = Field(0.5, gt=0.0, le=3.0)
    relaxation_time_relative_sd: float = Field(0.5, gt=0.0, le=3.0)


class CalibrationSettings(_Section):
    """The section `[calibration]` of an experiment file."""

    reference_temperature_c: float = Field(37.0, ge=0.0, le=120.0)
    attenuation: AttenuationPrior = AttenuationPrior()
    lesion: LesionPrior = LesionPrior()


class Constants(eqx.Module):
    """The constants that are fitted: what they are, how wide their priors are, and how a model takes them.

    Attributes:
        parameters: Attenuation at the anchors, then the lesion's stiffness, its rate and its relaxation time.
        prior_sd: Prior standard deviation of the logarithm of each.
        anchors: Temperatures of the attenuation values [degC].
    """

    parameters: tuple[Parameter, ...]
    prior_sd: Float[np.ndarray, " n"]
    anchors: Float[np.ndarray, " anchor"]

    def values(self, z: Float[Array, " n"]) -> Float[Array, " n"]:
        """Constants in their units from z, the logarithms in prior standard deviations."""
        return constrain(self.parameters, z * self.prior_sd)

    def coefficients(self, values: Float[Array, " n"]) -> Float[Array, " anchor"]:
        """Coefficients of the attenuation polynomial from the values at the anchors [percent]."""
        return jnp.linalg.solve(jnp.asarray(np.vander(self.anchors, increasing=True)), values[: len(self.anchors)])

    def apply(self, model: Model, values: Float[Array, " n"]) -> Model:
        """The model with these constants."""
        stiffness, rate, time = values[len(self.anchors) :]
        new = (self.coefficients(values), stiffness, rate, time)
        return eqx.tree_at(_places, model, new)


def _places(model: Model) -> tuple:
    attenuation, lesion = model.liver.attenuation, model.lesion.viscoelasticity
    assert isinstance(attenuation, NormalisedPolynomial)
    assert isinstance(lesion.branch_modulus, Exponential) and isinstance(lesion.relaxation_time, Linear)
    return (
        attenuation.coefficients,
        lesion.branch_modulus.value,
        lesion.branch_modulus.rate,
        lesion.relaxation_time.value,
    )


def constants_of(model: Model, settings: CalibrationSettings) -> Constants:
    """The constants to fit, with priors about the model's own values."""
    anchors = np.asarray(settings.attenuation.anchor_temperatures_c)
    attenuation = model.liver.attenuation
    assert isinstance(attenuation, NormalisedPolynomial)
    percent = np.asarray(attenuation.percent(anchors))
    if np.any(percent <= 0.0):
        raise InputError("`calibration.attenuation.anchor_temperatures_c`: the polynomial is not positive there.")
    _, stiffness, rate, time = _places(model)
    middle = model.lesion.viscoelasticity.branch_modulus.reference_temperature
    parameters = [
        Parameter(f"attenuation_at_{anchor:g}_degc", "percent", Positive(value), rf"attenuation at {anchor:g} °C")
        for anchor, value in zip(anchors, percent.tolist(), strict=True)
    ]
    parameters += [
        Parameter(f"lesion_branch_modulus_at_{middle:g}_degc", "Pa", Positive(stiffness), "lesion stiffness"),
        Parameter("lesion_branch_modulus_rate", "1/K", Positive(rate), "growth of lesion stiffness"),
        Parameter(f"lesion_relaxation_time_at_{middle:g}_degc", "s", Positive(time), "lesion relaxation time"),
    ]
    lesion = settings.lesion
    spread = [settings.attenuation.relative_sd] * len(anchors) + [
        lesion.branch_modulus_relative_sd,
        lesion.branch_modulus_rate_relative_sd,
        lesion.relaxation_time_relative_sd,
    ]
    return Constants(tuple(parameters), np.asarray(spread), anchors)


@dataclasses.dataclass(frozen=True)
class HmiFit:
    """A calibration.

    Attributes:
        constants: What was fitted.
        values: Most probable constants, in their units.
        standard_errors: Of the constants.
        correlation: Of the constants' logarithms.
        shrinkage: Posterior over prior standard deviation of each constant's logarithm.
        coefficients: Of the attenuation polynomial [percent, percent/K, ...].
        coefficient_errors: Their standard errors.
        model: The calibrated model.
        before: What the model gives for each row before the fit.
        after: What it gives after.
        noise_sd: Standard deviation of the data, given or estimated, a value a row.
        noise_estimated: Whether it was estimated.
        determined: Number of constants that the data determine, from 0 to all.
        descent: How the optimisation went.
    """

    constants: Constants
    values: Float[np.ndarray, " n"]
    standard_errors: Float[np.ndarray, " n"]
    correlation: Float[np.ndarray, "n n"]
    shrinkage: Float[np.ndarray, " n"]
    coefficients: Float[np.ndarray, " anchor"]
    coefficient_errors: Float[np.ndarray, " anchor"]
    model: Model
    before: Float[np.ndarray, " row"]
    after: Float[np.ndarray, " row"]
    noise_sd: Float[np.ndarray, " row"]
    noise_estimated: bool
    determined: float
    descent: Descent

    @property
    def not_identified(self) -> dict[str, str]:
        """For each constant that the data do not fix, its name and a sentence that says so."""
        return {
            parameter.name: f"{parameter.name} is not fixed by these data: its error is {ratio:.0%} of the prior's."
            for parameter, ratio in zip(self.constants.parameters, self.shrinkage, strict=True)
            if ratio > INFORMED_BELOW
        }


def fit_hmi(
    model: Model,
    data: HmiData,
    protocol: StepwiseProtocol,
    discretisation: Discretisation,
    settings: CalibrationSettings,
    *,
    on_step: Callable[[int, float], None] = lambda step, cost: None,
    max_steps: int = 30,
) -> HmiFit:
    """Calibrate a model to HMI data.

    Args:
        model: Starting point and centre of the priors.
        data: What was measured.
        protocol: What was done to the tissue.
        discretisation: Grids, mesh and steps.
        settings: Priors and reference temperature.
        on_step: Told the number of each step of the optimisation and its cost.
        max_steps: Steps after which the optimisation is stopped, and said not to have converged.

    Raises:
        InputError: if data and protocol do not go together.
    """
    constants = constants_of(model, settings)
    sweeps = plan_sweeps(data, protocol, settings.reference_temperature_c)
    unit = 1.0 if data.in_percent else float(data.displacement.mean()) / 100.0
    measured = jnp.asarray(data.displacement) / unit

    def simulate(z: Array) -> Array:
        calibrated = constants.apply(model, constants.values(z))
        n_rows = len(data.displacement)
        return predict(calibrated, sweeps, discretisation, n_rows=n_rows, in_percent=data.in_percent) / unit

    def residuals(z: Array, sd: Array) -> Array:
        return jnp.concatenate([(simulate(z) - measured) / sd, z])

    given = data.sd is not None
    sd = np.asarray(data.sd) / unit if given else np.full(len(measured), _FIRST_NOISE_PERCENT)
    sensitivity = jax.jit(jax.jacfwd(lambda z: (simulate(z),) * 2, has_aux=True))
    z = np.zeros(len(constants.parameters))
    before = np.asarray(sensitivity(z)[1])
    for _ in range(1 if given else _MOST_NOISE_UPDATES):
        descent = descend(residuals, z, jnp.asarray(sd), on_step=on_step, max_steps=max_steps)
        z = np.asarray(descent.solution)
        jacobian, after = (np.asarray(array) for array in sensitivity(z))
        covariance = np.linalg.inv((jacobian / sd[:, None] ** 2).T @ jacobian + np.eye(len(z)))
        determined = len(z) - float(np.trace(covariance))
        estimate = np.sqrt(np.sum((after - measured) ** 2) / (len(measured) - determined))
        if given or abs(estimate / sd[0] - 1.0) < _NOISE_TOLERANCE:
            break
        sd = np.full(len(measured), estimate)
    return _report(constants, model, z, covariance, before * unit, after * unit, sd * unit, given, descent)


def _report(constants, model, z, covariance, before, after, sd, given, descent) -> HmiFit:
    spread = np.sqrt(np.diag(covariance))
    values, value_covariance = delta_method(constants.values, z, covariance)
    coefficients, coefficient_covariance = delta_method(constants.coefficients, values, value_covariance)
    return HmiFit(
        constants=constants,
        values=values,
        standard_errors=np.sqrt(np.diag(value_covariance)),
        correlation=covariance / np.outer(spread, spread),
        shrinkage=spread,
        coefficients=coefficients,
        coefficient_errors=np.sqrt(np.diag(coefficient_covariance)),
        model=constants.apply(model, jnp.asarray(values)),
        before=before,
        after=after,
        noise_sd=sd,
        noise_estimated=not given,
        determined=len(z) - float(np.trace(covariance)),
        descent=descent,
    )
