"""Calibration of attenuation and lesion constants to HMI data: the most probable constants and their uncertainty.

Few HMI curves can fix five coefficients of attenuation and three constants of the lesion, so every constant has a
prior, log-normal about the model's own value, with a spread that the experiment file states. For attenuation it has
two parts: a level common to all temperatures, of which a normalised curve knows next to nothing, and a shape. With the
Cholesky factor L of the prior covariance the fit works on z, where L z are the constants' logarithms relative to the
prior's centre, and minimises

    sum ((simulated - measured) / s)^2 + sum z^2

by Levenberg-Marquardt with the exact Jacobian of the whole simulation chain. Where the data come without standard
deviations, s is estimated with them: s^2 = (sum of squared differences) / (n - g). The n readings do not count those of
100 percent at the reference temperature, which no model can miss; g, the number of constants that the data determine,
is the sum over constants of 1 minus the posterior variance of z (D. MacKay, Neural Computation 4 (1992) 415). Errors
are those of the linearised posterior.
"""

import dataclasses
from collections.abc import Callable
from typing import Annotated

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from pydantic import AllowInfNan, BaseModel, ConfigDict, Field, Strict, model_validator

from arfjax import Discretisation, Exponential, InputError, Linear, Model, NormalisedPolynomial, StepwiseProtocol
from inverse.datasets.hmi import HmiData
from inverse.hmi_model import plan_sweeps, predict, require_heating
from inverse.inference.hmi import used_rows
from inverse.least_squares import Descent, descend
from inverse.parameters import Parameter, constrain
from inverse.transforms import Positive
from inverse.uncertainty import delta_method

INFORMED_BELOW = 0.9
"""Posterior over prior standard deviation above which a constant counts as not fixed by the data."""

_NOISE_TOLERANCE = 0.01
_MOST_NOISE_UPDATES = 8
_FIRST_NOISE_PERCENT = 5.0


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


_Number = Annotated[float, Strict(), AllowInfNan(False)]
_Celsius = Annotated[_Number, Field(ge=0.0, le=120.0)]
_Spread = Annotated[_Number, Field(gt=0.0, le=3.0)]


class AttenuationPrior(_Section):
    """Attenuation is fitted as its values at five temperatures, which make the five coefficients.

    Its prior is a level common to all of them times a shape, independent from one to the next.
    """

    anchor_temperatures_c: tuple[_Celsius, _Celsius, _Celsius, _Celsius, _Celsius] = (35.0, 45.0, 55.0, 65.0, 84.0)
    level_relative_sd: Annotated[_Number, Field(gt=0.0, le=2.0)] = 0.25
    shape_relative_sd: Annotated[_Number, Field(gt=0.0, le=2.0)] = 0.25

    @model_validator(mode="after")
    def _anchors_differ(self) -> "AttenuationPrior":
        if any(b - a < 1.0 for a, b in zip(self.anchor_temperatures_c, self.anchor_temperatures_c[1:], strict=False)):
            raise ValueError(f"anchor_temperatures_c must rise by 1 K or more, got {self.anchor_temperatures_c}")
        return self


class LesionPrior(_Section):
    """Spread of the lesion's constants about the model's."""

    branch_modulus_relative_sd: _Spread = 0.5
    branch_modulus_rate_relative_sd: _Spread = 0.5
    relaxation_time_relative_sd: _Spread = 0.5


class CalibrationSettings(_Section):
    """The section `[calibration]` of an experiment file."""

    reference_temperature_c: _Celsius = 37.0
    attenuation: AttenuationPrior = AttenuationPrior()
    lesion: LesionPrior = LesionPrior()


class Constants(eqx.Module):
    """The constants that are fitted: what they are, how wide their priors are, and how a model takes them.

    Attributes:
        parameters: Attenuation at the anchors, then the lesion's stiffness, its rate and its relaxation time.
        prior_factor: Lower Cholesky factor of the prior covariance of their logarithms.
        anchors: Temperatures of the attenuation values [degC].
    """

    parameters: tuple[Parameter, ...]
    prior_factor: Float[np.ndarray, "n n"]
    anchors: Float[np.ndarray, " anchor"]

    def values(self, z: Float[Array, " n"]) -> Float[Array, " n"]:
        """Constants in their units from z, which the prior holds to be independent and standard normal."""
        return constrain(self.parameters, jnp.asarray(self.prior_factor) @ z)

    def coefficients(self, values: Float[Array, " n"]) -> Float[Array, " anchor"]:
        """Coefficients of the attenuation polynomial from the values at the anchors [percent]."""
        return jnp.linalg.solve(jnp.asarray(np.vander(self.anchors, increasing=True)), values[: len(self.anchors)])

    def apply(self, model: Model, values: Float[Array, " n"]) -> Model:
        """The model with these constants."""
        stiffness, rate, time = values[len(self.anchors) :]
        new = (self.coefficients(values), stiffness, rate, time)
        return eqx.tree_at(_places, model, new)


def _places(model: Model) -> tuple:
    attenuation, relaxation = model.liver.attenuation, model.lesion.viscoelasticity.relaxation_time
    # As `constants_of` asks for, and as `tissues.lesion_viscoelasticity` makes it.
    assert isinstance(attenuation, NormalisedPolynomial) and isinstance(relaxation, Linear)
    stiffness = _stiffness(model)
    return attenuation.coefficients, stiffness.value, stiffness.rate, relaxation.value


def _stiffness(model: Model) -> Exponential:
    law = model.lesion.viscoelasticity.branch_modulus
    assert isinstance(law, Exponential)  # as `tissues.lesion_viscoelasticity` makes it
    return law


def constants_of(model: Model, settings: CalibrationSettings) -> Constants:
    """The constants to fit, with priors about the model's own values."""
    anchors = np.asarray(settings.attenuation.anchor_temperatures_c)
    attenuation = model.liver.attenuation
    if not isinstance(attenuation, NormalisedPolynomial):
        raise InputError(
            "the liver's attenuation is no polynomial in temperature alone, whose coefficients are what is fitted: set "
            "`coagulation_doubles_attenuation = false` under liver."
        )
    percent = np.asarray(attenuation.percent(anchors))
    if np.any(percent <= 0.0):
        raise InputError("`calibration.attenuation.anchor_temperatures_c`: the polynomial is not positive there.")
    _, stiffness, rate, time = _places(model)
    middle = float(_stiffness(model).reference_temperature)
    parameters = [
        Parameter(f"attenuation_at_{anchor:g}_degc", "percent", Positive(value), rf"attenuation at {anchor:g} °C")
        for anchor, value in zip(anchors, percent.tolist(), strict=True)
    ]
    parameters += [
        Parameter(f"lesion_branch_modulus_at_{middle:g}_degc", "Pa", Positive(stiffness), "lesion stiffness"),
        Parameter("lesion_branch_modulus_rate", "1/K", Positive(rate), "growth of lesion stiffness"),
        Parameter(f"lesion_relaxation_time_at_{middle:g}_degc", "s", Positive(time), "lesion relaxation time"),
    ]
    return Constants(tuple(parameters), np.linalg.cholesky(_prior_covariance(settings)), anchors)


def _prior_covariance(settings: CalibrationSettings) -> Float[np.ndarray, "n n"]:
    attenuation, lesion = settings.attenuation, settings.lesion
    number = len(attenuation.anchor_temperatures_c)
    shape_and_lesion = [attenuation.shape_relative_sd] * number + [
        lesion.branch_modulus_relative_sd,
        lesion.branch_modulus_rate_relative_sd,
        lesion.relaxation_time_relative_sd,
    ]
    covariance = np.diag(np.square(shape_and_lesion))
    covariance[:number, :number] += attenuation.level_relative_sd**2
    return covariance


@dataclasses.dataclass(frozen=True)
class HmiFit:
    """A calibration.

    Attributes:
        constants: What was fitted.
        values: Most probable constants, in their units.
        standard_errors: Of the constants.
        correlation: Of the constants' logarithms.
        shrinkage: Posterior over prior standard deviation of each constant's logarithm.
        level_shrinkage: The same for the level of attenuation, the mean of its logarithms.
        coefficients: Of the attenuation polynomial [percent, percent/K, ...].
        coefficient_errors: Their standard errors.
        model: The calibrated model.
        before: What the model gives for each row before the fit.
        after: What it gives after.
        noise_sd: Standard deviation of the data, given or estimated, a value a row.
        noise_estimated: Whether it was estimated.
        noise_settled: Whether that estimate stopped changing.
        determined: Number of constants that the data determine, from 0 to all.
        descent: How the optimisation went.
    """

    constants: Constants
    values: Float[np.ndarray, " n"]
    standard_errors: Float[np.ndarray, " n"]
    correlation: Float[np.ndarray, "n n"]
    shrinkage: Float[np.ndarray, " n"]
    level_shrinkage: float
    coefficients: Float[np.ndarray, " anchor"]
    coefficient_errors: Float[np.ndarray, " anchor"]
    model: Model
    before: Float[np.ndarray, " row"]
    after: Float[np.ndarray, " row"]
    noise_sd: Float[np.ndarray, " row"]
    noise_estimated: bool
    noise_settled: bool
    determined: float
    descent: Descent

    @property
    def not_identified(self) -> dict[str, str]:
        """For each constant that the data do not fix, its name and a sentence that says so."""
        ratios = {"attenuation_level": self.level_shrinkage} | {
            parameter.name: float(ratio)
            for parameter, ratio in zip(self.constants.parameters, self.shrinkage, strict=True)
        }
        meaning = {"attenuation_level": " (a factor common to all temperatures)"}
        return {
            name: f"{name}{meaning.get(name, '')} is not fixed by these data: its error is {ratio:.0%} of the prior's."
            for name, ratio in ratios.items()
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
        InputError: if data and protocol do not go together, readings were taken while it cooled, or nothing tells how
            the data scatter.
    """
    constants = constants_of(model, settings)
    require_heating(data, protocol.duration)
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
    # Against time a curve is over the simulated value at the reference temperature, which no reading has to be.
    in_time = data.temperature is None
    informative = np.arange(len(measured)) if in_time else used_rows(data, settings.reference_temperature_c)
    if not (given or len(informative)):
        raise InputError(
            f"{data.path}: no row says anything of the model: all are 100 percent at "
            f"{settings.reference_temperature_c:g} degC, as any model is. Give readings at other temperatures."
        )
    sd = np.asarray(data.sd) / unit if given else np.full(len(measured), _FIRST_NOISE_PERCENT)
    fit = _at_noise(residuals, np.zeros(len(constants.parameters)), sd, on_step, max_steps)
    before = fit.differences_at_start
    settled = given
    for _ in range(0 if given else _MOST_NOISE_UPDATES):
        estimate = fit.noise_estimate(informative)
        settled = bool(abs(estimate / sd[0] - 1.0) < _NOISE_TOLERANCE)
        if settled:
            break
        sd = np.full(len(measured), estimate)
        fit = _at_noise(residuals, fit.z, sd, on_step, max_steps)
    after = (np.asarray(measured) + fit.differences) * unit
    return _report(constants, model, fit, (np.asarray(measured) + before) * unit, after, sd * unit, given, settled)


@dataclasses.dataclass(frozen=True)
class _Posterior:
    """The linearised posterior for one standard deviation of the data.

    Attributes:
        z: Most probable logarithms in prior standard deviations.
        covariance: Of z.
        differences: Simulated minus measured, there.
        differences_at_start: The same where the descent began.
        descent: How it went.
    """

    z: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n n"]
    differences: Float[np.ndarray, " row"]
    differences_at_start: Float[np.ndarray, " row"]
    descent: Descent

    @property
    def determined(self) -> float:
        """Number of constants that the data determine."""
        return len(self.z) - float(np.trace(self.covariance))

    def noise_estimate(self, rows: Int[np.ndarray, " some"]) -> float:
        """Standard deviation of the data that the differences in some rows speak for."""
        freedom = len(rows) - self.determined
        return float(np.sqrt(np.sum(self.differences[rows] ** 2) / freedom))


def _at_noise(residuals, start, sd, on_step, max_steps) -> _Posterior:
    descent = descend(residuals, start, jnp.asarray(sd), on_step=on_step, max_steps=max_steps)
    # The Jacobian's lower part is the prior's identity, so this is the posterior's precision.
    jacobian = np.asarray(descent.jacobian)
    return _Posterior(
        z=np.asarray(descent.solution),
        covariance=np.linalg.inv(jacobian.T @ jacobian),
        differences=np.asarray(descent.residual)[: len(sd)] * sd,
        differences_at_start=np.asarray(descent.first_residual)[: len(sd)] * sd,
        descent=descent,
    )


def _report(
    constants: Constants,
    model: Model,
    fit: _Posterior,
    before: Float[np.ndarray, " row"],
    after: Float[np.ndarray, " row"],
    sd: Float[np.ndarray, " row"],
    given: bool,
    settled: bool,
) -> HmiFit:
    factor = constants.prior_factor
    prior, posterior = factor @ factor.T, factor @ fit.covariance @ factor.T  # of the logarithms
    spread = np.sqrt(np.diag(posterior))
    anchors = slice(len(constants.anchors))
    values, value_covariance = delta_method(constants.values, fit.z, fit.covariance)
    coefficients, coefficient_covariance = delta_method(constants.coefficients, values, value_covariance)
    return HmiFit(
        constants=constants,
        values=values,
        standard_errors=np.sqrt(np.diag(value_covariance)),
        correlation=posterior / np.outer(spread, spread),
        shrinkage=spread / np.sqrt(np.diag(prior)),
        level_shrinkage=float(np.sqrt(posterior[anchors, anchors].sum() / prior[anchors, anchors].sum())),
        coefficients=coefficients,
        coefficient_errors=np.sqrt(np.diag(coefficient_covariance)),
        model=constants.apply(model, jnp.asarray(values)),
        before=before,
        after=after,
        noise_sd=sd,
        noise_estimated=not given,
        noise_settled=settled,
        determined=fit.determined,
        descent=fit.descent,
    )
