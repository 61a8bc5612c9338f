"""Affine-invariant ensemble sampling by emcee: no gradients, many walkers, one compiled call for all of them."""

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import emcee
import h5py
import jax
import numpy as np
from emcee.backends import Backend, HDFBackend
from jaxtyping import Float, PRNGKeyArray

from arfjax.errors import InputError
from inverse.inference.problem import Problem
from inverse.sampling.autocorrelation import StopRule, integrated_time
from inverse.sampling.checkpoint import opened, replaced
from inverse.sampling.draws import Draws
from inverse.sampling.inference_data import rank_r_hat
from inverse.sampling.laplace import Laplace
from inverse.sampling.target import (
    batched_log_density,
    fingerprint,
    prior_points,
    require_posterior,
    require_resumable,
    usable_points,
)

_SAVE_EVERY_S = 20.0
"""Between two looks, what a killed run may lose [s]."""
_BURN_IN_TIMES = 5.0
"""Autocorrelation times that are left out at the beginning; never more than half of the run."""
_GROUP = "mcmc"


class _BlockBackend(HDFBackend):
    """emcee's HDF5 file, written in blocks of steps, each of which replaces the file whole.

    emcee's own opens and closes the file at every step, which takes longer than the step, and a run that is killed in
    between may leave a file that cannot be read.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(str(path), name=_GROUP)
        self._path = path
        self._steps: list[tuple[emcee.State, np.ndarray]] = []

    def create(self, n_walkers: int, n: int, attributes: dict[str, str | int | float]) -> None:
        """A file without steps."""
        with replaced(self._path) as beside:
            HDFBackend(str(beside), name=_GROUP).reset(n_walkers, n)
            with h5py.File(beside, "a") as file:
                file.attrs.update(attributes)

    def grow(self, ngrow: int, blobs: object) -> None:
        """Nothing: the file grows by what is written."""

    def save_step(self, state: emcee.State, accepted: np.ndarray) -> None:
        """Keep a step until `write`."""
        self._steps.append((emcee.State(state, copy=True), np.array(accepted)))

    def write(self, seconds: float) -> None:
        """Put the steps kept so far into the file."""
        if not self._steps:
            return
        with replaced(self._path, copied=True) as beside, h5py.File(beside, "a") as file:
            group = file[_GROUP]
            assert isinstance(group, h5py.Group)
            attributes: Any = group.attrs
            done, count = int(attributes["iteration"]), len(self._steps)
            for name, kept in (("chain", "coords"), ("log_prob", "log_prob")):
                values = group[name]
                assert isinstance(values, h5py.Dataset)
                values.resize(done + count, axis=0)
                values[done:] = np.stack([getattr(state, kept) for state, _ in self._steps])
            total = group["accepted"]
            assert isinstance(total, h5py.Dataset)
            total[...] = total[...] + np.sum([accepted for _, accepted in self._steps], axis=0)
            for index, value in enumerate(self._steps[-1][0].random_state or ()):
                attributes[f"random_state_{index}"] = value
            attributes["iteration"] = done + count
            file.attrs["seconds"] = seconds
        self._steps.clear()


def walkers_from_laplace(
    problem: Problem, found: Laplace, *, count: int, seed: int = 0, chunk: int | None = None
) -> Float[np.ndarray, "walker n"]:
    """Walkers about the mode, all of finite density."""
    return usable_points(problem, found.draw, jax.random.key(seed), count, chunk=chunk)


def walkers_from_prior(
    problem: Problem, *, count: int, seed: int = 0, chunk: int | None = None
) -> Float[np.ndarray, "walker n"]:
    """Walkers all over the prior, all of finite density: where the posterior may have several modes."""

    def draw(key: PRNGKeyArray, number: int) -> Float[np.ndarray, "count n"]:
        return prior_points(problem, key, number)

    return usable_points(problem, draw, jax.random.key(seed), count, chunk=chunk)


def default_walkers(problem: Problem) -> int:
    """Four to a parameter and no fewer than 16; 128 where a batch of short predictions takes hardly longer than one."""
    return max(16 if problem.is_long else 128, 4 * problem.parameters.size)


def sample_ensemble(
    problem: Problem,
    start: Float[np.ndarray, "walker n"],
    *,
    seed: int,
    most_steps: int = 20_000,
    check_every: int = 500,
    rule: StopRule | None = None,
    moves: list[tuple[emcee.moves.Move, float]] | None = None,
    file: Path | None = None,
    chunk: int | None = None,
    on_step: Callable[[str], None] = lambda what: None,
) -> Draws:
    """Draws of the posterior by an ensemble of walkers, until their autocorrelation time says that it is enough.

    Args:
        problem: With a prior for every parameter.
        start: An even number of walkers, at least twice as many as parameters: from `walkers_from_laplace` or
            `walkers_from_prior`.
        seed: Of every random number of the run.
        most_steps: After which it ends without having met the rule, which the result then says.
        check_every: Steps between two looks at the autocorrelation time.
        rule: When to stop; 50 autocorrelation times that have settled within 1 %, and R-hat below 1.01, if not given.
        moves: Of emcee with their weights; if not given, differential evolution, which on bent ridges has half the
            autocorrelation time of the stretch move.
        file: HDF5 file of emcee, which is there at any moment. Where it holds a run of this problem, that goes on.
        chunk: Points whose density is computed at once; None for half of the walkers.
        on_step: Told in words how far it is, at every look.

    Returns:
        Draws after the burn-in of five autocorrelation times; `finished` is whether the rule was met.

    Raises:
        InputError: if there is no posterior, walkers do not suffice, a move is known to be wrong, or the file is of
            another run.
    """
    require_posterior(problem)
    _check_walkers(problem, start)
    _check_moves(moves)
    rule = StopRule() if rule is None else rule
    begun, evaluate = time.monotonic(), batched_log_density(problem, chunk=chunk)
    if not np.all(np.isfinite(evaluate(start))):
        raise InputError(
            "a walker starts where the log density is not finite: take starts from `walkers_from_laplace`."
        )
    before = _prepare(file, problem, start, seed, _in_words(moves))
    backend = Backend() if file is None else _BlockBackend(file)
    sampler = emcee.EnsembleSampler(
        len(start), start.shape[1], evaluate, vectorize=True, backend=backend, moves=moves or emcee.moves.DEMove()
    )
    done = int(np.asarray(backend.iteration)) if file is not None else 0
    if done == 0:
        sampler.random_state = np.random.RandomState(seed).get_state()
    state = None if done else emcee.State(np.array(start))
    looks = _Looks(rule, check_every)
    while done < most_steps and not looks.met(sampler, done):
        on_step(f"ensemble: {looks.said or f'{done} steps'}")
        steps = min(check_every - done % check_every, most_steps - done)
        state = _run_block(sampler, state, steps, lambda: before + time.monotonic() - begun)
        done += steps
    looks.met(sampler, done)
    return _result(sampler, looks, seed, done, before + time.monotonic() - begun)


def _in_words(moves: list[tuple[emcee.moves.Move, float]] | None) -> str:
    """By which a run that is resumed is told from one with other moves."""
    return ", ".join(f"{type(move).__name__} {weight:g}" for move, weight in moves or [(emcee.moves.DEMove(), 1.0)])


def _check_moves(moves: list[tuple[emcee.moves.Move, float]] | None) -> None:
    if any(isinstance(move, emcee.moves.DESnookerMove) for move, _ in moves or ()):
        raise InputError(
            "emcee's snooker move has a wrong acceptance up to 3.1.6 (dfm/emcee#531): posteriors come out too narrow, "
            "by 17 % in five dimensions. Take `DEMove` or `StretchMove`."
        )


def _check_walkers(problem: Problem, start: Float[np.ndarray, "walker n"]) -> None:
    count, size = start.shape[0], problem.parameters.size
    if start.shape[1] != size:
        raise InputError(f"walkers must have {size} unconstrained numbers each, got {start.shape[1]}.")
    if count % 2 or count < max(2 * size, 4):
        raise InputError(
            f"{count} walkers do not suffice for {size} parameters: take an even number of at least {max(2 * size, 4)}."
        )


def _prepare(file: Path | None, problem: Problem, start: Float[np.ndarray, "walker n"], seed: int, moves: str) -> float:
    """A file for the run, begun or found; the time that earlier sittings took [s]."""
    if file is None:
        return 0.0
    settings: dict[str, str | int | float] = {"sampler": "emcee", "seed": seed, "walkers": len(start), "moves": moves}
    if not file.exists():
        backend = _BlockBackend(file)
        backend.create(len(start), start.shape[1], {**fingerprint(problem), **settings, "seconds": 0.0})
        return 0.0
    require_resumable(file, problem, settings)
    with opened(file) as held:
        found: dict[str, Any] = dict(held.attrs)
    return float(found["seconds"])


def _run_block(
    sampler: emcee.EnsembleSampler, state: emcee.State | None, steps: int, elapsed: Callable[[], float]
) -> emcee.State:
    backend, saved = sampler.backend, time.monotonic()
    if state is None:  # the file's last step
        state = sampler.get_last_sample()
    last = state
    for each in sampler.sample(state, iterations=steps, skip_initial_state_check=True):
        last = each
        if isinstance(backend, _BlockBackend) and time.monotonic() - saved > _SAVE_EVERY_S:
            backend.write(elapsed())
            saved = time.monotonic()
    if isinstance(backend, _BlockBackend):
        backend.write(elapsed())
    return last


@dataclasses.dataclass
class _Looks:
    """Looks at the autocorrelation time at multiples of a number of steps, the same ones however often a run stops."""

    rule: StopRule
    every: int
    at: int = -1
    times: np.ndarray | None = None
    before: np.ndarray | None = None
    said: str = ""
    is_met: bool = False

    def met(self, sampler: emcee.EnsembleSampler, done: int) -> bool:
        """Whether the rule holds after so many steps."""
        if done == 0 or done == self.at or done % self.every:
            return self.is_met
        chain = np.asarray(sampler.get_chain())
        last = done - self.every
        if self.at == last and self.times is not None:
            self.before = self.times
        else:
            self.before = integrated_time(chain[:last]) if last else np.full(chain.shape[2], np.inf)
        self.times, self.at = integrated_time(chain), done
        self.said = self.rule.describe(self.before, self.times, done)
        self.is_met = self.rule.long_enough(self.before, self.times, done)
        if self.is_met:  # only then, since ranks of all steps take a second
            r_hat = _largest_r_hat(chain[_burn_in(self.times, done) :])
            self.said += f"; R-hat of walkers is {r_hat:.3f}"
            self.is_met = r_hat <= self.rule.r_hat
        return self.is_met


def _burn_in(times: Float[np.ndarray, " n"], done: int) -> int:
    longest = float(np.max(times))
    return int(min(np.ceil(_BURN_IN_TIMES * longest), done // 2)) if np.isfinite(longest) else done // 2


def _largest_r_hat(chain: Float[np.ndarray, "step walker n"]) -> float:
    found = [rank_r_hat(np.ascontiguousarray(chain[:, :, index].T)) for index in range(chain.shape[2])]
    return float(np.max(np.nan_to_num(found, nan=np.inf)))


def _result(sampler: emcee.EnsembleSampler, looks: _Looks, seed: int, done: int, seconds: float) -> Draws:
    chain, log_density = np.asarray(sampler.get_chain()), np.asarray(sampler.get_log_prob())
    times = integrated_time(chain) if looks.times is None else looks.times
    longest, burn_in = float(np.max(times)), _burn_in(times, done)
    said = looks.said or f"{done} steps"
    message = f"stopped by its rule: {said}" if looks.is_met else _unmet(looks.rule, said)
    return Draws(
        unconstrained=np.swapaxes(chain[burn_in:], 0, 1),
        log_density=np.swapaxes(log_density[burn_in:], 0, 1),
        statistics={},
        sampler=f"emcee {emcee.__version__}",
        seed=seed,
        settings={
            "walkers": sampler.nwalkers,
            "steps": done,
            "burn_in": burn_in,
            "autocorrelation_time": longest,
            "acceptance": float(np.mean(sampler.acceptance_fraction)),
        },
        finished=looks.is_met,
        message=message,
        evaluations=(done + 1) * sampler.nwalkers,
        seconds=seconds,
        walkers=True,
    )


def _unmet(rule: StopRule, said: str) -> str:
    return (
        f"the rule to stop was not met: {said}, asked for are more than {rule.times:g} times, a change below "
        f"{100.0 * rule.change:g} % and R-hat of at most {rule.r_hat:g}. Raise `most_steps` (`--steps`); "
        "with a file, the run goes on where it ended"
    )
