"""Corrections of no name in each link of the chain: which of them could take the misfit, smoothly along temperature.

A correction of a law of the tissue, or of what an instrument reads, is felt as much as the displacement depends on that
link in each state: one of the lesion's moduli in none without a lesion, one of the dose that coagulates where the
lesion begins. So links can be told apart, but for those of which displacement is a power throughout.
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from arfjax import Model
from inverse.diagnosis.cause import Strength
from inverse.diagnosis.decision import REPLICATES
from inverse.diagnosis.evidence import evidence
from inverse.diagnosis.free_forms import COARSE, Place, process
from inverse.diagnosis.hmi.cause import HmiCause, HmiConditions, States, TissueChange
from inverse.diagnosis.hmi.fitting import HmiFit
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.noise import Noise
from inverse.diagnosis.screening import Alternative, Screen
from inverse.diagnosis.where import Absorbed, absorbed_by_places

_COLDEST, _OTHERS = 0.0, 1.0
"""Second parameter of a link: whether it is changed in the coldest state, which displacement is divided by, or in all
others. What displacement does in each state is told from both."""


class _Link(HmiCause):
    """A link that is changed alike in all states but one, or in that one."""

    name, place, unit, sign, plausible = "link", "tissue", "1", 0, 1.0
    sentence = helps = source = "A correction of no name."
    shapes = (_COLDEST, _OTHERS)

    @staticmethod
    def where(conditions: HmiConditions, strength: Strength, shape: Strength) -> States:
        """The strength, where it acts. The end of the sonication, which nothing is read at, stays as it is."""
        temperature = conditions.temperature
        coldest = temperature <= jnp.min(temperature)
        is_end = jnp.arange(len(temperature)) == len(temperature) - 1
        return jnp.where(is_end, 0.0, strength * jnp.where(coldest, 1.0 - shape, shape))


class _TemperatureLink(_Link):
    place = "instruments: thermocouple"

    def temperature(
        self, temperature: States, conditions: HmiConditions, strength: Strength, shape: Strength
    ) -> States:
        return temperature + self.where(conditions, strength, shape)


class _TissueLink(_Link):
    """One field of `TissueChange`: multiplied by a number near 1, or that number less 1 added to it."""

    field: str = eqx.field(static=True)
    added: bool = eqx.field(static=True, default=False)

    def tissue(
        self, change: TissueChange, conditions: HmiConditions, model: Model, strength: Strength, shape: Strength
    ) -> TissueChange:
        del model
        more = self.where(conditions, strength, shape)
        value = getattr(change, self.field)
        moved = value + more if self.added else value * (1.0 + more)
        return eqx.tree_at(lambda tree: getattr(tree, self.field), change, moved)


_LINKS: dict[str, HmiCause] = {
    "in the temperature of the focus, as read or as simulated": _TemperatureLink(),
    "in the attenuation of liver": _TissueLink("attenuation"),
    "in the sound speed of liver": _TissueLink("sound_speed", added=True),
    "in the moduli of liver": _TissueLink("liver_modulus"),
    "in the moduli of the lesion": _TissueLink("lesion_modulus"),
    "in the lesion's edge": _TissueLink("rim", added=True),
    "in the dose that coagulates": _TissueLink("threshold"),
    "in the force of the push, or in what displacement is read as": _TissueLink("force"),
}


def slopes_of_links(
    problem: HmiDiagnosisProblem, unknowns: Float[np.ndarray, " unknown"]
) -> dict[str, Float[np.ndarray, "row 2"]]:
    """Derivative of the logarithm of displacement in every link, at its row's state and at the coldest of its course.

    Returns:
        For every link in words two columns: what a change in all states but the coldest does, and one in that alone.
    """
    program = problem.program.with_causes(tuple(_LINKS.values()))
    count, constants = len(_LINKS), unknowns[problem.program.constants]
    found = []
    for shape in (_OTHERS, _COLDEST):
        at = np.concatenate([np.zeros(count), np.full(count, shape), constants])
        found.append(program.slopes(at, range(count)))
    return {words: np.stack([one[:, i] for one in found], axis=-1) for i, words in enumerate(_LINKS)}


def absorbed_by_links(null: HmiFit, family: Sequence[Noise], rng: np.random.Generator) -> tuple[Absorbed, ...]:
    """What a smooth correction in each link takes of the misfit of the fit without causes, the most first.

    Args:
        null: That fit.
        family: Noise members, white first.
        rng: For replicates.
    """
    rows, problem = null.problem.rows, null.problem
    waves = process(rows.temperature, COARSE)
    believed = len(null.residuals) - len(rows)
    forms, places, coldest = [], [], _coldest_of_course(problem)
    for words, slopes in slopes_of_links(problem, null.unknowns).items():
        felt = slopes[:, :1] * waves + slopes[:, 1:] * waves[coldest]
        directions = np.pad(problem.weights[:, None] * felt, [(0, believed), (0, 0)])
        forms.append(Alternative(words, directions))
        places.append(Place(words, words))
    screen = Screen(null.directions, forms, family)
    free = np.ones(len(screen.alternatives), dtype=bool)
    tested = evidence(screen, null.residuals, rng, free, 1.0, REPLICATES, averaged=True)
    found = absorbed_by_places(tested, places)
    return tuple(sorted(found, key=lambda one: -one.share))


def _coldest_of_course(problem: HmiDiagnosisProblem) -> Int[np.ndarray, " row"]:
    """For each row the one in the state that the displacement of its course is divided by."""
    found = np.zeros(len(problem.rows), dtype=int)
    for course in problem.program.courses:
        mine = np.asarray(course.rows)
        found[mine] = mine[np.argmin(problem.rows.temperature[mine])]
    return found
