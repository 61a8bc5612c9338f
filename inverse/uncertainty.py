r"""What a least-squares optimum says about its parameters: standard errors, correlations, and what it cannot tell.

Everything follows from the Jacobian $J$ of the residuals in the *values* of the parameters (not in unconstrained
numbers), which stays finite at the ends of the parameters' ranges. To first order the covariance is
$s^2 (J^T J)^{-1}$, with the residual variance $s^2$, or 1 where residuals are already in standard deviations.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from inverse.parameters import Parameter
from inverse.transforms import Positive

LARGEST_LOG_ERROR = 1.0
"""Standard error of a logarithm above which the data do not fix the parameter, not even its power of e."""

SINGULAR = 1e-3
"""Singular value of the scaled Jacobian below which a combination of parameters counts as free."""


@dataclasses.dataclass(frozen=True)
class Uncertainty:
    """Standard errors of a fit and the sentences that go with them.

    Attributes:
        covariance: Of the parameter values, in their units.
        standard_errors: Of the parameter values; infinite where a parameter does not touch the residuals.
        correlation: Of the parameter values.
        residual_variance: Sum of squared residuals over degrees of freedom; reduced chi-square if they are scaled.
        not_identified: For each parameter that the data do not fix, its name and a sentence that says why.
        remarks: What else the reader must know, such as a free combination of parameters.
    """

    covariance: Float[np.ndarray, "n n"]
    standard_errors: Float[np.ndarray, " n"]
    correlation: Float[np.ndarray, "n n"]
    residual_variance: float
    not_identified: dict[str, str]
    remarks: tuple[str, ...]


def assess(
    jacobian: Float[np.ndarray, "m n"],
    residuals: Float[np.ndarray, " m"],
    values: Float[np.ndarray, " n"],
    parameters: Sequence[Parameter],
    *,
    ends: Sequence[str | None],
    in_standard_deviations: bool = False,
) -> Uncertainty:
    """Standard errors, correlations and identifiability at a least-squares optimum.

    Args:
        jacobian: Derivative of the residuals in the values of the parameters.
        residuals: At the optimum.
        values: Of the parameters, at the optimum.
        parameters: What the values are.
        ends: For each parameter the end of its range at which it lies, or None (see `Transform.end`).
        in_standard_deviations: Whether residuals were divided by known standard deviations.

    Returns:
        Standard errors and sentences. Without degrees of freedom all errors are infinite, and a remark says so.
    """
    count, number = jacobian.shape
    freedom = count - number
    variance = float(residuals @ residuals) / freedom if freedom > 0 else math.inf
    covariance, free = invert_information(jacobian)
    covariance = covariance * (1.0 if in_standard_deviations else variance)
    errors = np.sqrt(np.diag(covariance))
    names = [parameter.name for parameter in parameters]
    remarks = _free_combination(jacobian, values, names)
    if freedom <= 0 and not in_standard_deviations:
        remarks = (f"{count} data for {number} constants: nothing is left over to estimate errors from.", *remarks)
    return Uncertainty(
        covariance=covariance,
        standard_errors=errors,
        correlation=_correlation(covariance),
        residual_variance=variance,
        not_identified=_not_identified(parameters, values, errors, ends, free),
        remarks=remarks,
    )


def invert_information(jacobian: Float[np.ndarray, "m n"]) -> tuple[Float[np.ndarray, "n n"], list[bool]]:
    """Inverse of J^T J, and for each parameter whether it does not touch the residuals at all.

    Columns are scaled to unit length first, so that units do not matter. A parameter of no effect has infinite
    variance; a combination of no effect has a variance so large that no digit of it is to be trusted.
    """
    lengths = np.linalg.norm(jacobian, axis=0)
    free = lengths == 0.0
    covariance = np.diag(np.where(free, np.inf, 0.0))
    if not np.all(free):
        kept = np.flatnonzero(~free)
        singular, directions = _principal(jacobian[:, kept] / lengths[kept])
        scaled = directions / np.maximum(singular, 1e-12 * singular[0])[:, None]
        scaled = scaled / lengths[kept][None, :]
        covariance[np.ix_(kept, kept)] = scaled.T @ scaled
    return covariance, [bool(value) for value in free]


def delta_method(
    function: Callable[[Float[jax.Array, " n"]], Float[jax.Array, " k"]],
    values: Float[np.ndarray, " n"],
    covariance: Float[np.ndarray, "n n"],
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k k"]]:
    """Derived quantities and their covariance, to first order: transforms, sums and ratios of parameters."""
    derivative = np.asarray(jax.jacfwd(function)(jnp.asarray(values)))
    return np.asarray(function(jnp.asarray(values))), derivative @ covariance @ derivative.T


def _principal(jacobian: Float[np.ndarray, "m n"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
    """Singular values and their directions, one a row; 0 for those that fewer data than parameters do not feel."""
    rows, columns = jacobian.shape
    whole = np.concatenate([jacobian, np.zeros((max(columns - rows, 0), columns))])
    _, singular, directions = np.linalg.svd(whole, full_matrices=False)
    return singular, directions


def _correlation(covariance: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """Correlations; 0 with a parameter whose variance is infinite or zero."""
    errors = np.sqrt(np.diag(covariance))
    usable = np.isfinite(errors) & (errors > 0.0)
    scale = np.where(usable, errors, 1.0)
    pairs = usable[:, None] & usable[None, :]
    ratio = np.where(pairs, covariance, 0.0) / np.outer(scale, scale)
    return np.where(np.eye(len(errors), dtype=bool), 1.0, ratio)


def _not_identified(parameters, values, errors, ends, free) -> dict[str, str]:
    sentences = {}
    for parameter, value, error, end, unfelt in zip(parameters, values, errors, ends, free, strict=True):
        name = parameter.name
        shown = f"{value:.3g} {parameter.unit}" if parameter.unit != "1" else f"{value:.3g}"
        if end == "lower" and isinstance(parameter.transform, Positive):
            sentences[name] = (
                f"{name} is not fixed by these data: the fit ran to zero, with which they are compatible (it stopped "
                f"at {shown}, which is as good as none)."
            )
        elif end is not None:
            sentences[name] = (
                f"{name} is not fixed by these data: the fit ran to the {end} end of its range ({shown}), "
                f"so its value is a bound, not an estimate."
            )
        elif unfelt:
            sentences[name] = f"{name} is not fixed by these data: it has no effect on any of them at {shown}."
        elif not error <= LARGEST_LOG_ERROR * abs(value):
            ratio = error / abs(value) if value else math.inf
            sentences[name] = (
                f"{name} is not fixed by these data: its standard error is {ratio:.2g} times its value of {shown}."
            )
    return sentences


def _free_combination(jacobian, values, names) -> tuple[str, ...]:
    """A sentence about the relative changes of parameters that leave the fit all but unchanged, if there are such."""
    lengths = np.linalg.norm(jacobian, axis=0)
    kept = np.flatnonzero((lengths > 0.0) & (values != 0.0))
    if len(kept) < 2:
        return ()
    singular, directions = _principal(jacobian[:, kept] / lengths[kept])
    if singular[-1] > SINGULAR * singular[0]:
        return ()
    relative = directions[-1] / (lengths[kept] * values[kept])
    relative = relative / relative[np.argmax(np.abs(relative))]
    moved = [(names[index], change) for index, change in zip(kept, relative, strict=True) if abs(change) > 0.05]
    if len(moved) == 1:
        return (f"The data hardly tell {moved[0][0]}: changed by itself, it leaves the fit all but the same.",)
    together = ", ".join(f"{name} by {change:+.2g} %" for name, change in moved)
    return (f"The data do not tell apart a joint change of {together}: the fit stays all but the same.",)
