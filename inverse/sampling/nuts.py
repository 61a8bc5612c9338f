"""The no-U-turn sampler by blackjax: Hamiltonian trajectories along the gradient of the log density.

Chains move in coordinates whitened by the Laplace approximation, u = mode + L z, in which the posterior is near a
standard normal one, so that trajectories are short and the mass matrix has little left to learn.
"""

import importlib.metadata
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray

from inverse.inference.compiled import as_arrays
from inverse.inference.problem import Problem
from inverse.sampling.checkpoint import read_checkpoint, write_checkpoint
from inverse.sampling.draws import Draws
from inverse.sampling.laplace import Laplace
from inverse.sampling.target import fingerprint, require_posterior, require_resumable, usable_points

_STATISTICS = ("diverging", "acceptance_rate", "n_steps", "tree_depth", "energy")


class _Chains(eqx.Module):
    """Where all chains stand, and how they move; states are blackjax's `HMCState`."""

    states: Any
    step_size: Float[Array, "*chain"]
    inverse_mass: Float[Array, "*chain n n"]


def sample_nuts(
    problem: Problem,
    found: Laplace,
    *,
    seed: int,
    chains: int = 4,
    warmup: int = 500,
    draws: int = 1000,
    target_acceptance: float = 0.8,
    most_doublings: int = 10,
    chunk: int = 100,
    file: Path | None = None,
    on_step: Callable[[str], None] = lambda what: None,
) -> Draws:
    """Draws of the posterior by NUTS, several chains in one compiled program.

    Args:
        problem: With a prior for every parameter and a differentiable likelihood.
        found: From `laplace`: where chains start, and the coordinates in which they move.
        seed: Of every random number of the run.
        chains: Run side by side.
        warmup: Steps in which each chain finds its step size and mass matrix by Stan's windows; not kept.
        draws: Of each chain, at least; the last chunk is filled up.
        target_acceptance: Higher ones take shorter steps, against divergences.
        most_doublings: Of a trajectory, which then has at most two to the power of it steps.
        chunk: Draws between two reports, after which the file is written.
        file: HDF5 file of the run, which is there at any moment. Where it holds a run of this problem, that goes on.
        on_step: Told in words how far it is.

    Returns:
        Draws with `diverging`, `acceptance_rate`, `n_steps`, `tree_depth` and `energy` of each; `finished` is whether
        no trajectory diverged or was cut short.

    Raises:
        InputError: if there is no posterior, no usable start, or the file is of another run.
    """
    require_posterior(problem)
    begun, key = time.monotonic(), jax.random.key(seed)
    settings: dict[str, str | int | float] = {
        "sampler": "nuts",
        "seed": seed,
        "chains": chains,
        "warmup": warmup,
        "target_acceptance": target_acceptance,
        "most_doublings": most_doublings,
    }
    numbers = as_arrays(problem)
    start_key, warm_key, draw_key = jax.random.split(key, 3)
    kept: dict[str, list[np.ndarray]] = {name: [] for name in ("unconstrained", "log_density", *_STATISTICS)}
    before = 0.0
    if file is not None and file.exists():
        state, kept, centre, factor, before = _read(file, problem, settings)
    else:
        on_step("nuts: warm-up")
        centre, factor = jnp.asarray(found.mode), jnp.asarray(found.factor)
        start = usable_points(problem, found.draw, start_key, chains)
        positions = jnp.asarray(np.linalg.solve(found.factor, (start - found.mode).T).T)
        state = _warm_up(
            numbers,
            centre,
            factor,
            jax.random.split(warm_key, chains),
            positions,
            warmup,
            target_acceptance,
            most_doublings,
        )
    keys = jax.random.split(draw_key, chains)
    done = sum(part.shape[1] for part in kept["unconstrained"])
    while done < draws:
        on_step(f"nuts: {done} of {draws} draws, {int(sum(np.sum(part) for part in kept['diverging']))} divergences")
        state, out = _advance(numbers, centre, factor, state, keys, jnp.asarray(done), chunk, most_doublings)
        for name, values in zip(kept, out, strict=True):
            kept[name].append(np.array(values))
        done += chunk
        if file is not None:
            _write(file, problem, settings, state, kept, centre, factor, before + time.monotonic() - begun)
    return _result(state, kept, settings, draws, before + time.monotonic() - begun)


def _density(problem: Problem, centre: Array, factor: Array) -> Callable[[Float[Array, " n"]], Float[Array, ""]]:
    return lambda z: problem.log_density(centre + factor @ z)


@eqx.filter_jit
def _warm_up(
    problem: Problem,
    centre: Float[Array, " n"],
    factor: Float[Array, "n n"],
    keys: Key[Array, " chain"],
    positions: Float[Array, "chain n"],
    steps: int,
    target_acceptance: float,
    most_doublings: int,
) -> _Chains:
    # Here, as in other functions: its import starts JAX, before a program has set what only counts until then.
    import blackjax
    from blackjax.adaptation.base import get_filter_adapt_info_fn

    adaptation: Any = blackjax.window_adaptation(
        blackjax.nuts,
        _density(problem, centre, factor),
        target_acceptance_rate=target_acceptance,
        # Dense: the curvature at the mode says little of a posterior that is bent.
        is_mass_matrix_diagonal=False,
        adaptation_info_fn=get_filter_adapt_info_fn(),
        max_num_doublings=most_doublings,
    )

    def one(key: PRNGKeyArray, position: Float[Array, " n"]) -> _Chains:
        result, _ = adaptation.run(key, position, num_steps=steps)
        return _Chains(result.state, result.parameters["step_size"], result.parameters["inverse_mass_matrix"])

    return jax.vmap(one)(keys, positions)


@eqx.filter_jit
def _advance(
    problem: Problem,
    centre: Float[Array, " n"],
    factor: Float[Array, "n n"],
    chains: _Chains,
    keys: Key[Array, " chain"],
    first: Int[Array, ""],
    count: int,
    most_doublings: int,
) -> tuple[_Chains, tuple[Array, ...]]:
    """So many draws of each chain, of which the first has the number `first`: its random numbers follow from that."""
    import blackjax

    kernel: Any = blackjax.nuts.build_kernel()
    density = _density(problem, centre, factor)

    def one(chain: _Chains, key: PRNGKeyArray) -> tuple[Any, tuple[Array, ...]]:
        def step(state: Any, number: Int[Array, ""]) -> tuple[Any, tuple[Any, ...]]:
            state, info = kernel(
                jax.random.fold_in(key, number), state, density, chain.step_size, chain.inverse_mass, most_doublings
            )
            return state, (
                centre + factor @ state.position,
                state.logdensity,
                info.is_divergent,
                info.acceptance_rate,
                info.num_integration_steps,
                info.num_trajectory_expansions,
                info.energy,
            )

        return jax.lax.scan(step, chain.states, first + jnp.arange(count))

    states, out = jax.vmap(one)(chains, keys)
    return _Chains(states, chains.step_size, chains.inverse_mass), out


def _write(
    file: Path,
    problem: Problem,
    settings: dict[str, str | int | float],
    state: _Chains,
    kept: dict[str, list[np.ndarray]],
    centre: Array,
    factor: Array,
    seconds: float,
) -> None:
    arrays = {name: np.concatenate(parts, axis=1) for name, parts in kept.items()}
    arrays |= {"state_position": state.states.position, "state_log_density": state.states.logdensity}
    arrays |= {"state_gradient": state.states.logdensity_grad, "step_size": state.step_size}
    arrays |= {"inverse_mass": state.inverse_mass, "centre": centre, "factor": factor}
    numbers = {name: np.asarray(values) for name, values in arrays.items()}
    write_checkpoint(file, numbers, {**fingerprint(problem), **settings, "seconds": seconds})


def _read(
    file: Path, problem: Problem, settings: dict[str, str | int | float]
) -> tuple[_Chains, dict[str, list[np.ndarray]], Array, Array, float]:
    require_resumable(file, problem, settings)
    arrays, attributes = read_checkpoint(file)
    from blackjax.mcmc.hmc import HMCState

    state_of: Any = HMCState
    state = state_of(*(jnp.asarray(arrays[f"state_{name}"]) for name in ("position", "log_density", "gradient")))
    chains = _Chains(state, jnp.asarray(arrays["step_size"]), jnp.asarray(arrays["inverse_mass"]))
    kept = {name: [arrays[name]] for name in ("unconstrained", "log_density", *_STATISTICS)}
    return chains, kept, jnp.asarray(arrays["centre"]), jnp.asarray(arrays["factor"]), float(attributes["seconds"])


def _result(
    state: _Chains,
    kept: dict[str, list[np.ndarray]],
    settings: dict[str, str | int | float],
    asked: int,
    seconds: float,
) -> Draws:
    arrays = {name: np.concatenate(parts, axis=1) for name, parts in kept.items()}
    divergences = int(np.sum(arrays["diverging"]))
    cut = int(np.sum(arrays["tree_depth"] >= int(settings["most_doublings"])))
    count = arrays["unconstrained"].shape[1]
    message = f"{count} draws of each chain, {'as asked' if count == asked else f'of which {asked} were asked for'}"
    if divergences:
        message += (
            f"; {divergences} trajectories diverged, so that narrow corners of the posterior may be missing: raise "
            "`target_acceptance` (`--target-acceptance`), or look for a parameter that the data do not determine"
        )
    if cut:
        doublings = settings["most_doublings"]
        message += f"; {cut} trajectories were cut short at {doublings} doublings, so that draws are worth less"
    return Draws(
        unconstrained=arrays["unconstrained"],
        log_density=arrays["log_density"],
        statistics={name: arrays[name] for name in _STATISTICS},
        sampler=f"blackjax {importlib.metadata.version('blackjax')} NUTS",
        seed=int(settings["seed"]),
        settings={**settings, "draws": count, "step_size": float(np.median(np.asarray(state.step_size)))},
        finished=divergences == 0 and cut == 0,
        message=message,
        evaluations=int(np.sum(arrays["n_steps"])),
        seconds=seconds,
    )
