"""Curves of displacement examined."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from inverse.diagnosis.cause import Extension
from inverse.diagnosis.decision import Refitted, decide
from inverse.diagnosis.examination import (
    Examined,
    extension_of,
    in_white_noise,
    linear_strengths,
    require_seen,
    visible_alternatives,
)
from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.fitting import Fitting, HmiFit, moved_by
from inverse.diagnosis.hmi.free_forms import hmi_free_forms, hmi_local_forms, of_all_data
from inverse.diagnosis.hmi.noise_size import noise_size
from inverse.diagnosis.hmi.problem import Effect, HmiDiagnosisProblem
from inverse.diagnosis.hmi.profile import profiled
from inverse.diagnosis.hmi.refit import SETTLED, again_from, fit_hmi, fit_in_full
from inverse.diagnosis.hmi.rough_fit import RoughFit, in_full, rough_fits
from inverse.diagnosis.hmi.twin import spanning, twin_strength
from inverse.diagnosis.noise import Noise
from inverse.diagnosis.projection import independent, project_out
from inverse.diagnosis.screening import Alternative, Screen


def examine_hmi(
    causes: Sequence[HmiCause],
    null: HmiFit,
    rng: np.random.Generator,
    *,
    size: float,
    corrected: bool = True,
    level: float = 0.05,
    replicates: int | None = None,
    asked: Sequence[str] = (),
) -> Examined:
    """Test every cause and every free form on fitted curves.

    Args:
        causes: The library to look in; the problem's program holds them all.
        null: The fit without causes, in white noise.
        rng: For replicates.
        size: Of the noise, in units of the weights: what the priors count against.
        corrected: Whether the fast simulation is corrected to the full one where each refit comes out.
        level: Probability of finding something wrong where nothing is.
        replicates: Data sets of noise alone that error rates are calibrated on: if not said, see `replicates_at`.
        asked: Names of causes that the data have to see.

    Raises:
        InputError: if they cannot see one that was asked for.
    """
    problem = null.problem
    family = problem.noise_family()
    null, noise = _in_its_noise(null, family, size)
    residuals, fitted = null.residuals, null.directions
    spread = noise_size(null)
    names = {cause.name for cause in causes}
    found = [one for one in problem.alternatives(null.unknowns, fitted, spread) if one.name in names]
    seen, not_testable = visible_alternatives(found, residuals, fitted, spread, causes)
    require_seen(asked, [one.name for one in seen], not_testable)
    forms, places = hmi_free_forms(problem.rows, problem.rows.log_displacement - null.of_readings / problem.weights)
    forms = of_all_data(forms, problem.weights, len(residuals))
    local_forms = of_all_data(hmi_local_forms(problem.rows), problem.weights, len(residuals))

    effects = [one for one in found if any(one is other for other in seen)]
    rough = rough_fits_of(null, noise, effects, family, size, corrected=corrected)
    refits = Refits(null, family, size=size, corrected=corrected, starts=rough)

    def extend(added: Sequence[Alternative], noise: Noise) -> Refitted:
        extensions = [extension_of(causes, one) for one in added]
        # Of the sign that was looked for: in other noise the other one may be the likelier.
        strengths, signs = linear_strengths(added, residuals, fitted), np.array([one.sign for one in added])
        refit = refits(extensions, noise, np.where(signs == 0, strengths, signs * np.abs(strengths)), False)
        inside = {one.name for one in added}
        # The other causes as they are without this one: to follow it they would take longer than all fits together.
        others = [one for one in found if one.name not in inside]
        # Outside of what is known of the simulation a fit is worth no more than one without the cause.
        misfit = refit.misfit if refit.converged else max(refit.misfit, _misfit_in(noise, residuals, fitted))
        return Refitted(refit.residuals, refit.directions, misfit, others, refit.converged)

    looked_for = [one.alternative for one in rough]
    decision = decide(
        residuals,
        fitted,
        looked_for,
        forms,
        family,
        rng,
        extend=extend,
        level=level,
        replicates=replicates,
        few=True,
        local_forms=local_forms,
    )
    return Examined(
        causes=tuple(causes),
        residuals=residuals,
        fitted=fitted,
        seen=tuple(seen),
        not_testable=not_testable,
        places=tuple(places),
        family=family,
        decision=decision,
        fit=refits,
        remarks=(),
    )


class Refits:
    """Fits of the full simulation with causes in it, each done once; in other noise from where it came out.

    Attributes:
        null: The fit without causes, in the likeliest kind of noise.
    """

    def __init__(
        self,
        null: HmiFit,
        family: Sequence[Noise],
        *,
        size: float,
        corrected: bool,
        starts: Sequence[RoughFit] = (),
    ) -> None:
        """Begin.

        Args:
            null: The fit without causes.
            family: Noise members.
            size: Of the noise, in units of the weights.
            corrected: Whether to correct the fast simulation.
            starts: Rough fits of causes, beside the fit without any.
        """
        self._starts = tuple(fit for fit in starts if np.isfinite(fit.misfit))
        self.null, self._family = null, tuple(family)
        self._size, self._corrected = size, corrected
        self._near: dict[tuple[str, ...], HmiFit] = {}
        self._done: dict[tuple[tuple[str, ...], int, bool], HmiFit] = {}

    def __call__(
        self, extensions: Sequence[Extension], noise: Noise, start: Float[np.ndarray, " extension"], profile: bool
    ) -> HmiFit:
        """Constants and extensions together, these by name."""
        order = sorted(range(len(extensions)), key=lambda i: extensions[i].cause.name)
        extensions, start = [extensions[i] for i in order], np.asarray(start)[order]
        names = tuple(extension.cause.name for extension in extensions)
        member = next(number for number, one in enumerate(self._family) if one is noise)
        if names not in self._near:
            self._near[names] = self._done[names, member, False] = self._first(extensions, noise, start)
        if (names, member, False) not in self._done:
            self._done[names, member, False] = again_from(self._near[names], noise, self._size)
        if (names, member, profile) not in self._done:
            self._done[names, member, True] = self._profiled(self._done[names, member, False], noise)
        return self._done[names, member, profile]

    def _first(self, extensions, noise, start) -> HmiFit:
        problem, unknowns = self.null.problem, self.null.unknowns
        if len(extensions) == 1 and (rough := self._rough(extensions[0], start[0], noise)) is not None:
            return self._from(rough.unknowns, rough.strength, extensions[0], noise)
        if (single := self._single(extensions)) is not None:
            problem, unknowns = single.problem, single.unknowns
            extensions = [single.extensions[0] if e.cause is single.extensions[0].cause else e for e in extensions]
            mine = [e.cause is single.extensions[0].cause for e in extensions]
            start = np.where(mine, single.strengths[0], start)
        return self._fit(problem, extensions, noise, start=unknowns, strengths=start)

    def _fit(self, problem: HmiDiagnosisProblem, extensions: Sequence[Extension], noise: Noise, **begun) -> HmiFit:
        return (fit_in_full if self._corrected else fit_hmi)(problem, extensions, noise, size=self._size, **begun)

    def _from(
        self, unknowns: Float[np.ndarray, " unknown"], strength: float, extension: Extension, noise: Noise
    ) -> HmiFit:
        problem = self.null.problem
        if self._corrected:
            # Where it is corrected to the full simulation, fits come out: not where there is no such cause.
            near = problem.corrected_at(unknowns, moved_by(problem, [extension]))
            problem = near if near.correction is not None and near.correction.is_finite else problem
        return self._fit(problem, [extension], noise, start=unknowns, strengths=np.array([strength]))

    def _profiled(self, fit: HmiFit, noise: Noise) -> HmiFit:
        """With intervals, that of one cause over all strengths that are known to describe the data."""
        found = profiled(fit, noise, self._size)
        strength = twin_strength(found, noise, self._size)
        if strength is None:
            return found
        extension, start = found.extensions[0], found.unknowns.copy()
        start[found.problem.program.place(extension.cause.name)] = strength / extension.cause.plausible
        twin = self._from(start, strength, extension, noise)
        if not twin.converged or twin.left > SETTLED:
            return found
        # On the way to its ends a twin that is the worse fit may fall back to the better one.
        ends = profiled(twin, noise, self._size)
        lower, upper = found.intervals[0]
        twin = twin if lower <= ends.strengths[0] <= upper else ends
        return found if lower <= twin.strengths[0] <= upper else spanning(found, twin)

    def _rough(self, extension: Extension, strength: float, noise: Noise) -> RoughFit | None:
        """The best rough fit along whose way it was tested: of its shape, and with the sign that it goes with."""
        named = (extension.cause.name, extension.shape)
        mine = [fit for fit in self._starts if (fit.alternative.name, fit.shape) == named]
        # By the fast simulation as it is, as they were made: a correction about the null fit is not for where they are.
        fitting = Fitting(dataclasses.replace(self.null.problem, correction=None), (), noise, self._size)
        return min(
            (fit for fit in mine if fit.strength * strength > 0.0),
            key=lambda fit: float(np.sum(fitting.stacked(fit.unknowns) ** 2)),
            default=None,
        )

    def _single(self, extensions: Sequence[Extension]) -> HmiFit | None:
        """The better fit of one of two extensions alone."""
        alone = [self._near[names] for e in extensions if (names := (e.cause.name,)) in self._near]
        return min((fit for fit in alone if fit.converged), key=lambda fit: fit.misfit, default=None)

    def remarks(self) -> tuple[str, ...]:
        """What is to be said of fits that the full simulation had not settled, and of intervals."""
        unsettled = [
            f"{' and '.join(names)}: where the fit came out, the full simulation is {fit.left:.1f} standard deviations "
            "of the noise (all readings together) from what was fitted."
            for names, fit in self._near.items()
            if fit.converged and fit.left > SETTLED
        ]
        ends = [(names, fit.remarks) for (names, _, profile), fit in self._done.items() if profile]
        return (
            *self.null.remarks,
            *unsettled,
            *(f"{' and '.join(names)}: {one}" for names, remarks in ends for one in remarks),
        )


def rough_fits_of(
    null: HmiFit, noise: Noise, effects: Sequence[Effect], family: Sequence[Noise], size: float, *, corrected: bool
) -> list[RoughFit]:
    """Rough fits of causes by the fast simulation as it is, and what the full one says of the best.

    Args:
        null: The fit without causes.
        noise: What it was weighed with.
        effects: Of the causes, about that fit.
        family: Noise members.
        size: Of the noise, in units of the weights: what the priors count against.
        corrected: Whether the full simulation is asked at all.
    """
    spread, plain = noise_size(null), dataclasses.replace(null.problem, correction=None)
    found: list[tuple[HmiFit, list[RoughFit]]] = []
    # In white noise, too: what is likeliest without the cause is the noise that leaves it least to explain.
    for kind in [noise] if noise.is_white else [noise, family[0]]:
        if corrected:
            # Wherever it comes out: a way is one to look along, and what comes of it is asked of the full simulation.
            begun = fit_hmi(plain, (), kind, size=size, start=null.unknowns)
        else:
            begun = null if kind is noise else again_from(null, kind, size)
        since = found[0][0] if found else begun
        fits = rough_fits(begun, kind, effects, size=size, spread=spread, since=since)
        # Of an effect without a fit there is one way, whatever the noise.
        found.append((begun, [one for one in fits if kind is noise or np.isfinite(one.misfit)]))
    return in_full(found, null, family, size) if corrected else [one for _, fits in found for one in fits]


def _in_its_noise(null: HmiFit, family: Sequence[Noise], size: float) -> tuple[HmiFit, Noise]:
    """The model fitted in the likeliest kind of noise, and that; see `examine_dma`."""
    _, member, _ = Screen(null.directions, (), family).noise_evidence(null.residuals[:, None])
    noise = family[member[0]]
    if noise.is_white:
        return null, noise
    again = again_from(null, noise, size)
    if again.converged:
        return again, noise
    return dataclasses.replace(null, remarks=(*null.remarks, in_white_noise(again.status))), family[0]


def _misfit_in(noise: Noise, residuals, fitted) -> float:
    """Sum of squares that the fit without causes leaves, in coordinates in which a noise is white."""
    return float(np.sum(project_out(noise.whiten(residuals[:, None]), independent(noise.whiten(fitted))) ** 2))
