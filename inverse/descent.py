"""Minima of a function of which a gradient has been compiled and nothing else, step by step from outside of JAX.

For functions that take longer to compile than to run: `inverse.minimise` is the batched way for all others. BFGS
(scipy) in coordinates whitened by the curvature, finished by damped Newton steps; curvatures are differences of
gradients.
"""

import dataclasses
import warnings
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy import optimize

Gradient = Callable[[Float[np.ndarray, " n"]], tuple[float, Float[np.ndarray, " n"]]]

CONVERGED = 1e-6
"""Newton decrement below which a point is a minimum: what a step more would gain, in units of the function."""
LEAST_CURVATURE = 0.1
"""Curvature at least taken for directions along which the function hardly curves: a spread of about 3."""

BFGS_STEPS = 300
NEWTON_STEPS = 50
"""Steps at most, unless told otherwise."""
_OUT_OF_STEPS = 1
"""What scipy's status of BFGS is where the number of steps ended it."""
_FIRST_STEP, _STEP = 1e-4, 1e-2
"""Steps of differences: of the variable, and in units of its spread."""
_NOWHERE = 1e10
"""Value where there is none, from which a line search turns back; ten times that at the start if this is higher."""
_SADDLE = -1e-6
"""Least curvature, over the largest, of what counts as a minimum."""


@dataclasses.dataclass(frozen=True)
class Expansion:
    """A function to second order about a point.

    Attributes:
        value: There.
        slope: Its gradient.
        curvature: Its Hessian, symmetric; NaN where gradients nearby are no numbers.
    """

    value: float
    slope: Float[np.ndarray, " n"]
    curvature: Float[np.ndarray, "n n"]

    @property
    def is_finite(self) -> bool:
        """Whether all of it is a number."""
        return bool(np.isfinite(self.value) and np.all(np.isfinite(self.slope)) and np.all(np.isfinite(self.curvature)))


@dataclasses.dataclass(frozen=True)
class Descent:
    """Where a search ended.

    Attributes:
        point: The lowest found.
        value: There; infinite if it is not a number.
        gain: What one more Newton step would gain.
        n_steps: Steps taken.
        out_of_steps: Whether it ended because no more steps were allowed, not by itself.
    """

    point: Float[np.ndarray, " n"]
    value: float
    gain: float
    n_steps: int
    out_of_steps: bool = False

    @property
    def converged(self) -> bool:
        """Whether the point is a minimum."""
        return self.gain < CONVERGED


def expand(
    gradient: Gradient, point: Float[np.ndarray, " n"], scale: Float[np.ndarray, " n"] | None = None
) -> Expansion:
    """Value, gradient and Hessian, by differences of gradients along directions of unit curvature.

    Twice, since the first time no such directions are known. It takes 8 n + 1 gradients.

    Args:
        gradient: Value and gradient.
        point: About which.
        scale: A large change of each variable; 1 if not given.

    Accuracy: differences of the fourth order are exact to ten digits of the largest curvature, in units of the scale.
    """
    width = np.ones(len(point)) if scale is None else scale
    value, slope = gradient(point)
    factor, step, curvature = np.eye(len(point)), _FIRST_STEP, np.full((len(point), len(point)), np.nan)
    for _ in range(2):
        near, far = (
            np.stack([_difference(gradient, point, width, k * step * each) / (k * step) for each in factor.T])
            for k in (1.0, 2.0)
        )
        # Rows are derivatives along the columns of the factor.
        found = np.linalg.solve(factor.T, (4.0 * near - far) / 3.0)
        if not np.all(np.isfinite(found)):
            break  # the wider steps left the function's domain: the narrow ones stand, if those did not
        curvature = 0.5 * (found + found.T)
        factor, step = whitening(curvature), _STEP
    return Expansion(value, slope, curvature / np.outer(width, width))


def _difference(
    gradient: Gradient, point: Float[np.ndarray, " n"], width: Float[np.ndarray, " n"], change: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    (up, above), (down, below) = (gradient(point + sign * width * change) for sign in (1.0, -1.0))
    # Outside of its domain a function may have a gradient, of nothing.
    return 0.5 * width * (above - below) if np.isfinite(up + down) else np.full(len(point), np.nan)


def whitening(curvature: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """Principal directions, each so long that the function curves by one along it; the unit matrix if not finite."""
    if not np.all(np.isfinite(curvature)):
        return np.eye(len(curvature))
    values, vectors = np.linalg.eigh(curvature)
    return vectors / np.sqrt(np.maximum(np.abs(values), LEAST_CURVATURE))


def descend(
    gradient: Gradient,
    start: Float[np.ndarray, " n"],
    factor: Float[np.ndarray, "n n"] | None = None,
    *,
    max_steps: int = BFGS_STEPS,
) -> Descent:
    """BFGS in whitened coordinates.

    Args:
        gradient: Value and gradient; a search turns back from where they are not finite.
        start: Where it begins.
        factor: Coordinates, one a column, in which the function curves by about one; from the curvature at the start
            if not given.
        max_steps: Steps after which it is stopped.
    """
    if factor is None:
        about = expand(gradient, start)
        axes, begun = whitening(about.curvature), about.value
    else:
        axes, begun = factor, gradient(start)[0]
    nowhere = max(_NOWHERE, 10.0 * abs(begun)) if np.isfinite(begun) else _NOWHERE

    def cost(z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        value, slope = gradient(start + axes @ z)
        if not (np.isfinite(value) and np.all(np.isfinite(slope))):
            return nowhere, np.zeros_like(z)
        return value, axes.T @ slope

    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # of line searches that end early: what was reached is judged later
        found = optimize.minimize(
            cost, np.zeros_like(start), jac=True, method="BFGS", options={"maxiter": max_steps, "gtol": 1e-5}
        )
    value = float(found.fun)
    sound = value < nowhere
    # In these coordinates the curvature is about one.
    gain = 0.5 * float(np.sum(np.asarray(found.jac) ** 2)) if sound else np.inf
    stopped = int(found.status) == _OUT_OF_STEPS
    return Descent(start + axes @ found.x, value if sound else np.inf, gain, int(found.nit), stopped)


def polish(gradient: Gradient, begun: Descent, *, max_steps: int = NEWTON_STEPS) -> Descent:
    """Newton steps with as much damping as it takes to go down, from where a descent ended.

    Args:
        gradient: Value and gradient.
        begun: The descent.
        max_steps: Steps after which it is stopped; with none it is only told whether the point is a minimum.
    """
    point, here = begun.point, expand(gradient, begun.point)
    damping, gain, steps, stopped = 0.0, np.inf, begun.n_steps, False
    while True:
        if not here.is_finite:
            gain = np.inf
            break
        eigenvalues, vectors = np.linalg.eigh(here.curvature)
        along = vectors.T @ here.slope
        safe = np.where(eigenvalues > 0.0, eigenvalues, np.maximum(np.abs(eigenvalues), LEAST_CURVATURE))
        gain = float(0.5 * np.sum(along**2 / safe))
        if gain < CONVERGED**2:
            gain = gain if is_minimum(here.curvature) else np.inf
            break
        if steps - begun.n_steps >= max_steps:
            gain = gain if is_minimum(here.curvature) else np.inf
            stopped = not gain < CONVERGED
            break
        candidate = point - vectors @ (along / (safe + damping * np.max(safe)))
        there = expand(gradient, candidate)
        steps += 1
        if np.isfinite(there.value) and there.value <= here.value:
            point, here, damping = candidate, there, 0.1 * damping if damping > 1e-8 else 0.0
        elif gain < CONVERGED:
            gain = gain if is_minimum(here.curvature) else np.inf
            break  # what is left to gain is below rounding
        else:
            damping = max(10.0 * damping, 1e-6)
    return Descent(point, here.value if np.isfinite(here.value) else np.inf, gain, steps, stopped)


def is_minimum(curvature: Float[np.ndarray, "n n"]) -> bool:
    """Whether a function of this curvature falls nowhere, where its gradient is zero."""
    eigenvalues = np.linalg.eigvalsh(curvature)
    return bool(eigenvalues[0] >= _SADDLE * max(abs(eigenvalues[-1]), LEAST_CURVATURE))


def newton_gain(slope: Float[np.ndarray, " n"], curvature: Float[np.ndarray, "n n"]) -> float:
    """What one Newton step would take off a function, each direction of negative curvature turned round."""
    eigenvalues, axes = np.linalg.eigh(0.5 * (curvature + curvature.T))
    size = np.maximum(np.abs(eigenvalues), 1e-8 * np.max(np.abs(eigenvalues)))
    return float(0.5 * np.sum((axes.T @ slope) ** 2 / size))
