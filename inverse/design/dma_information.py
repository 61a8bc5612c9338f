r"""Where one more reading of a sample would tell two causes apart best, found by gradients.

Either cause may be the true one, as strong as the data have it. The other one, of a sign that it may have, and the
constants of the solid are then fitted to what it does to the data that there are; $\Delta(f)$ is what that leaves at
frequency $f$ and one of the temperatures measured (logarithm of the magnitude, and phase), all to first order. A
reading there is expected to favour the true one by $\| \Delta(f) \|^2 / 2 \sigma^2$ nat, $\sigma$ the noise: the
criterion of Atkinson & Fedorov (1975, Biometrika 62, 57-70) for telling two models apart, here the smaller of both. At
the best temperature L-BFGS-B climbs along the gradient from the best of some frequencies. At a temperature that was not
measured the solid has constants of its own, so that one reading there tells nothing.
"""

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from inverse.bounded import multi_start_bounded
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.dma.cause import DmaCause, DmaConditions
from inverse.diagnosis.dma.problem import DmaProblem, in_constants, in_strengths

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
    size: Float[np.ndarray, " coordinate"],
) -> Information:
    """Tell what a further reading of the first sample would, as the first of a visit after everything else.

    Args:
        problem: What was measured.
        extensions: Two causes.
        strengths: That each would have.
        size: Standard deviation of the noise of each coordinate, relative.
    """
    fitted, constants = problem.fitted_directions(), jnp.asarray(problem.constants)
    moved = [one.directions[:, 0] for one in problem.directions(extensions)]
    imitated = [
        jnp.asarray(_imitation(fitted, moved[1 - true], extensions[1 - true].cause.sign, strengths[true] * moved[true]))
        for true in (0, 1)
    ]

    def nat(sweep: Int[Array, ""] | int, log_omega: Float[Array, ""]) -> Float[Array, ""]:
        conditions = _one_more(problem, jnp.asarray(sweep), log_omega)
        slopes = in_constants(constants, conditions, problem.has_phase)[-1][..., : len(problem.model.constants())]
        effects = in_strengths(constants, conditions, tuple(extensions), problem.has_phase)[:, -1]
        slopes = slopes.reshape(len(slopes), -1)
        left = [
            strengths[true] * effects[true] - jnp.column_stack([slopes, effects[1 - true]]) @ imitated[true]
            for true in (0, 1)
        ]
        return 0.5 * jnp.minimum(*(jnp.sum((one / size) ** 2) for one in left))

    log_omega = np.log(np.asarray(problem.conditions.angular_frequency))
    lower, upper = log_omega.min(keepdims=True), log_omega.max(keepdims=True)
    grid, members = np.linspace(lower[0], upper[0], _FREQUENCIES), _members(problem)
    over = jax.jit(jax.vmap(jax.vmap(nat, (None, 0)), (0, None)))
    values = np.asarray(over(jnp.asarray(members), jnp.asarray(grid)))
    largest = max(float(values.max()), 1e-300)
    row, column = np.unravel_index(int(np.argmax(values)), values.shape)
    top = multi_start_bounded(
        lambda at: -nat(members[row], at[0]) / largest, jnp.asarray(grid[[column]][None]),
        jnp.asarray(lower), jnp.asarray(upper), scale=jnp.ones(1),
    )  # fmt: skip
    return Information(
        causes=(extensions[0].cause.name, extensions[1].cause.name),
        temperature=np.array([problem.sweeps[one].temperature_c for one in members]),
        frequency=np.exp(grid) / (2.0 * np.pi),
        nat=values,
        best_temperature=problem.sweeps[members[row]].temperature_c,
        best_frequency=float(np.exp(top.solutions[0, 0]) / (2.0 * np.pi)),
        best=-float(top.costs[0]) * largest,
    )


def _imitation(
    fitted: Float[np.ndarray, "n p"], rival: Float[np.ndarray, " n"], sign: int, target: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " p_and_1"]:
    """Of what is fitted, and of a rival of one sign (0 for either), that come closest to the target."""
    found = _coefficients(np.column_stack([fitted, rival]), target)
    return np.append(_coefficients(fitted, target), 0.0) if sign * found[-1] < 0.0 else found


def _coefficients(directions: Float[np.ndarray, "n p"], target: Float[np.ndarray, " n"]) -> Float[np.ndarray, " p"]:
    """Of the directions, that come closest to the target."""
    lengths = np.maximum(np.linalg.norm(directions, axis=0), 1e-300)
    return np.linalg.lstsq(directions / lengths, target, rcond=None)[0] / lengths


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
