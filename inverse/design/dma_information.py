r"""Where one more reading of a sample would tell two causes apart best, found by gradients.

Each cause is put into the model by itself and fitted to the data that there are. A reading at frequency $f$ and one of
the temperatures measured is then expected to favour the true one by $\| \Delta(f) \|^2 / 2 \sigma^2$ nat, with $\Delta$
the difference of what the two predict (logarithm of the magnitude, and phase) and $\sigma$ the noise: the criterion of
Atkinson & Fedorov (1975, Biometrika 62, 57-70) for telling two models apart. At each temperature L-BFGS-B climbs along
the gradient from the best of some frequencies. At a temperature that was not measured the solid has constants of its
own, so that one reading there tells nothing.
"""

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from inverse.bounded import multi_start_bounded
from inverse.diagnosis.cause import DmaCause, DmaConditions, Extension
from inverse.diagnosis.dma_problem import DmaProblem, predict_coordinates
from inverse.diagnosis.extended_fit import ExtendedFit, fit_extended
from inverse.diagnosis.noise import noise_family

_FREQUENCIES = 29
"""At which information is given."""


@dataclasses.dataclass(frozen=True)
class Information:
    """What a further reading is expected to tell of two causes.

    Attributes:
        causes: The two.
        temperature: Those measured, ascending [degC].
        frequency: Within those measured [Hz].
        nat: By which a reading there is expected to favour the true one.
        best_temperature: Where that is largest [degC].
        best_frequency: The same [Hz].
        best: That largest value [nat].
    """

    causes: tuple[str, str]
    temperature: Float[np.ndarray, " t"]
    frequency: Float[np.ndarray, " f"]
    nat: Float[np.ndarray, "t f"]
    best_temperature: float
    best_frequency: float
    best: float


def dma_information(
    problem: DmaProblem,
    extensions: Sequence[Extension[DmaCause]],
    strengths: Float[np.ndarray, " 2"],
    size: float,
    library: Sequence[DmaCause],
) -> Information:
    """Tell what a further reading of the first sample would, as the first of a visit after everything else.

    Args:
        problem: What was measured.
        extensions: Two causes.
        strengths: First guesses of their fits.
        size: Standard deviation of the noise, relative.
        library: Causes.
    """
    white = noise_family(problem.orderings(), problem.frequencies(), unit="Hz")[0]
    fits = [
        fit_extended(problem, (extension,), white, np.array([strength]), library=library, profile=False)
        for extension, strength in zip(extensions, strengths, strict=True)
    ]

    def nat(sweep: Int[Array, ""] | int, log_omega: Float[Array, ""]) -> Float[Array, ""]:
        one, other = (_coordinates(problem, fit, sweep, log_omega) for fit in fits)
        return 0.5 * jnp.sum((one - other) ** 2) / size**2

    log_omega = np.log(np.asarray(problem.conditions.angular_frequency))
    lower, upper = log_omega.min(keepdims=True), log_omega.max(keepdims=True)
    grid, members = np.linspace(lower[0], upper[0], _FREQUENCIES), _members(problem)
    over = jax.jit(jax.vmap(jax.vmap(nat, (None, 0)), (0, None)))
    values = np.asarray(over(jnp.asarray(members), jnp.asarray(grid)))
    row, column = np.unravel_index(int(np.argmax(values)), values.shape)
    top = multi_start_bounded(
        lambda at: -nat(members[row], at[0]) / float(values.max()), jnp.asarray(grid[[column]][None]),
        jnp.asarray(lower), jnp.asarray(upper), scale=jnp.ones(1),
    )  # fmt: skip
    return Information(
        causes=(extensions[0].cause.name, extensions[1].cause.name),
        temperature=np.array([problem.sweeps[one].temperature_c for one in members]),
        frequency=np.exp(grid) / (2.0 * np.pi),
        nat=values,
        best_temperature=problem.sweeps[members[row]].temperature_c,
        best_frequency=float(np.exp(top.solutions[0, 0]) / (2.0 * np.pi)),
        best=-float(top.costs[0]) * float(values.max()),
    )


def _coordinates(
    problem: DmaProblem, fit: ExtendedFit, sweep: Int[Array, ""] | int, log_omega: Float[Array, ""]
) -> Float[Array, " coordinate"]:
    """Logarithm of the magnitude, and phase where it was measured, of a reading more."""
    conditions = _one_more(problem, jnp.asarray(sweep), log_omega)
    constants, strengths = jnp.asarray(fit.constants), jnp.asarray(fit.strengths)
    return predict_coordinates(constants, conditions, fit.extensions, strengths, problem.has_phase)[-1]


def _one_more(problem: DmaProblem, sweep: Int[Array, ""], log_omega: Float[Array, ""]) -> DmaConditions:
    """What was measured, and a reading more."""
    was = problem.conditions
    rows = np.flatnonzero(np.isin(np.asarray(was.sweep), _members(problem)))
    last = rows[np.argmax(np.asarray(was.time)[rows])]
    like = jnp.argmax(was.sweep == sweep)
    return DmaConditions(
        angular_frequency=jnp.append(was.angular_frequency, jnp.exp(log_omega)),
        temperature=jnp.append(was.temperature, was.temperature[like]),
        time=jnp.append(was.time, was.time[last]),
        time_in_sweep=jnp.append(was.time_in_sweep, 0.0),
        exposure=jnp.append(was.exposure, was.exposure[last]),
        level=jnp.append(was.level, was.level[like]),
        softest=was.softest,
        stiffest=was.stiffest,
        sweep=jnp.append(was.sweep, sweep),
        visit=jnp.append(was.visit, jnp.max(was.visit) + 1),
        sweep_before=jnp.append(was.sweep_before, was.sweep[last]),
    )


def _members(problem: DmaProblem) -> list[int]:
    """Sweeps of the first sample by ascending temperature."""
    mine = [index for index, sweep in enumerate(problem.sweeps) if sweep.sample == problem.sweeps[0].sample]
    return sorted(mine, key=lambda index: problem.sweeps[index].temperature_c)
