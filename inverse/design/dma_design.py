"""The next dynamic mechanical analysis: which would tell the causes apart that are still alive."""

import dataclasses
import functools
from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Float

from arfjax import FractionalZener, complex_modulus
from inverse.datasets.dma import DmaData
from inverse.design.design import Design, Rated, alive, checked, reasons
from inverse.design.dma_conditions import as_at_first
from inverse.design.dma_information import dma_information
from inverse.design.dma_proposals import DmaProposal, clock_of, dma_proposals
from inverse.design.separation import Separation, separation
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.choice import find_causes
from inverse.diagnosis.diagnosis import Diagnosis
from inverse.diagnosis.dma.cause import DmaCause, predicted_modulus
from inverse.diagnosis.dma.causes import DMA_CAUSES
from inverse.diagnosis.dma.diagnosis import diagnose_dma
from inverse.diagnosis.dma.problem import DmaProblem, dma_problem
from inverse.dma_fit import FRACTIONAL, ZenerModel
from inverse.resolution import diagnosed_as_measured


def design_dma(
    data: DmaData,
    *,
    found: Diagnosis | None = None,
    causes: Sequence[str] = (),
    model: ZenerModel = FRACTIONAL,
    library: Sequence[DmaCause] = DMA_CAUSES,
    check: bool = True,
    locate: bool = True,
    seed: int = 0,
    on_step: Callable[[str], None] = lambda _: None,
) -> Design:
    """Rate what could be measured next by how well it would tell causes apart.

    Args:
        data: What was measured.
        found: Its diagnosis; made if not given.
        causes: To be told apart; those that the diagnosis leaves possible, or the two likeliest, without.
        model: The null model.
        library: Causes.
        check: Whether to simulate the best proposal with each cause and to diagnose it again.
        locate: Whether to look where one more reading would tell most of the two that are the hardest to tell apart.
        seed: Of random orders and simulations.
        on_step: Told what is being done.

    Raises:
        InputError: if there are no two causes to tell apart, or the fit itself failed.
    """
    wanted = [cause.name for cause in find_causes(causes, library)]
    data = data.without_copies()
    remarks: tuple[str, ...] = ()
    if found is None:
        on_step("diagnosing")
        diagnosis = functools.partial(
            diagnose_dma, model=model, causes=library, seed=seed, gain=False, asked=wanted, on_step=on_step
        )
        data, found, remarks = diagnosed_as_measured(data, diagnosis, seed)
    extensions, strengths = alive(found, causes, library)
    assert found.noise is not None
    # Of each coordinate, relative, as deviations that a file states say nothing of readings that are still to come.
    size = found.noise.size * np.median(1.0 / found.problem.weights, axis=0)
    problem = dma_problem(_plain(data), model, seed=seed)
    now = _separation(problem, extensions, strengths, size)
    rated: list[tuple[DmaProposal, Separation]] = []
    for proposal in dma_proposals(data, sample=problem.sweeps[0].sample, seed=seed):
        on_step(f"rating: {proposal.words}")
        further = _further(_with(data, problem, proposal), problem, seed)
        rated.append((proposal, _separation(further, extensions, strengths, size)))
    rated.sort(key=lambda one: -one[1].worst)
    checks = []
    if check:
        best = rated[0][0]
        together = _with(data, problem, best)
        for number, (extension, strength) in enumerate(zip(extensions, strengths, strict=True)):
            on_step(f"simulating {best.name} with {extension.cause.name}")
            further = _further(together, problem, seed + 1 + number)
            simulated = _simulated(together, further, extension, strength, size)
            again = diagnose_dma(simulated, model=model, causes=library, seed=seed, gain=False)
            checks.append(checked(extension.cause.name, again))
    names = {e.cause.name: float(s) for e, s in zip(extensions, strengths, strict=True)}
    information = None
    if locate:
        on_step("where one more reading tells most")
        pair = list(now.closest)
        information = dma_information(found.problem, [extensions[i] for i in pair], strengths[pair], size)
    return Design(
        found.verdict, names, now, tuple(Rated(*one) for one in rated), tuple(checks),
        tuple(size.tolist()), seed,
        (*remarks, *reasons(found, causes, tuple(names))), information,
    )  # fmt: skip


def _separation(problem: DmaProblem, extensions, strengths, size: Float[np.ndarray, " coordinate"]) -> Separation:
    problem = dataclasses.replace(problem, weights=problem.weights / size)
    alternatives = problem.directions(extensions)
    directions = np.concatenate([one.directions for one in alternatives], axis=1)
    names = [extension.cause.name for extension in extensions]
    signs = [extension.cause.sign for extension in extensions]
    return separation(names, directions, strengths, problem.fitted_directions(), 1.0, signs)


def _further(together: DmaData, problem: DmaProblem, seed: int) -> DmaProblem:
    """Data and proposal as a problem in which strengths and shapes mean what they do in the data."""
    further = dma_problem(together, problem.model, seed=seed, whole_drying=problem.whole_drying)
    return as_at_first(further, problem)


def _with(data: DmaData, problem: DmaProblem, proposal: DmaProposal) -> DmaData:
    """Data and proposal together, the proposal's readings as the fitted model has them."""
    modulus = np.array(
        [
            complex(complex_modulus(FractionalZener(*_constants_at(problem, proposal.sample, t)), 2.0 * np.pi * f))
            for f, t in zip(proposal.frequency, proposal.temperature, strict=True)
        ]
    )
    time = np.asarray(_plain(data).time_s)
    return _data(
        data,
        np.append(data.frequency_hz, proposal.frequency),
        np.append(data.temperature_c, proposal.temperature),
        np.append(time, proposal.time),
        (*data.sample, *([proposal.sample] * len(proposal) if data.sample else [])),
        np.append(_modulus(data), modulus),
    )


def _plain(data: DmaData) -> DmaData:
    """The data without deviations, rows counted where there is no time."""
    return _data(data, data.frequency_hz, data.temperature_c, clock_of(data), data.sample, _modulus(data))


def _modulus(data: DmaData) -> Complex[np.ndarray, " n"]:
    if not data.has_phase:
        return np.asarray(data.modulus_magnitude) + 0j
    return np.asarray(data.storage_modulus) + 1j * np.asarray(data.loss_modulus)


def _data(data: DmaData, frequency, temperature, time, sample, modulus) -> DmaData:
    return DmaData(
        frequency_hz=frequency,
        temperature_c=temperature,
        modulus_magnitude=np.abs(modulus),
        storage_modulus=modulus.real if data.has_phase else None,
        loss_modulus=modulus.imag if data.has_phase else None,
        time_s=time,
        sample=sample,
    )


def _constants_at(problem: DmaProblem, sample: str, temperature: float) -> Float[np.ndarray, " 4"]:
    """Constants of a sample at a temperature: logarithms, and the order, linear between those that were fitted."""
    mine = [index for index, sweep in enumerate(problem.sweeps) if sweep.sample == sample]
    order = sorted(mine, key=lambda index: problem.sweeps[index].temperature_c)
    known = np.array([problem.sweeps[index].temperature_c for index in order])
    constants = problem.constants[order]
    moduli = [np.interp(temperature, known, np.log(np.maximum(constants[:, k], 1e-12))) for k in range(3)]
    return np.append(np.exp(moduli), np.interp(temperature, known, constants[:, 3]))


def _simulated(
    together: DmaData,
    problem: DmaProblem,
    extension: Extension[DmaCause],
    strength: float,
    size: Float[np.ndarray, " coordinate"],
) -> DmaData:
    """The whole measurement with a cause in it and noise of the problem's seed, sweep by sweep."""
    modulus = np.asarray(
        predicted_modulus(jnp.asarray(problem.constants), problem.conditions, (extension,), jnp.asarray([strength]))
    )
    rng = np.random.default_rng(problem.seed)
    noise = size * rng.standard_normal((len(modulus), len(size)))
    read = modulus * np.exp(noise @ np.array([1.0, 1.0j])[: len(size)])
    sweeps = [sweep.data for sweep in problem.sweeps]
    return _data(
        together,
        np.concatenate([one.frequency_hz for one in sweeps]),
        np.concatenate([one.temperature_c for one in sweeps]),
        np.concatenate([np.asarray(one.time_s) for one in sweeps]),
        tuple(label for one in sweeps for label in one.sample),
        read,
    )
