"""Corrections of no name in each link of the chain: their slopes, and that the link with an effect takes it."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from inverse.diagnosis.free_forms import COARSE, process
from inverse.diagnosis.hmi import links
from inverse.diagnosis.hmi.account import HmiAccount
from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.fitting import HmiFit
from inverse.diagnosis.hmi.links import slopes_of_links
from inverse.diagnosis.hmi.refit import fit_hmi
from tests.inverse.diagnosis.hmi.cases import TEMPERATURES, bare, measured_with, white

FOCUS, EDGE = "in the temperature of the focus, as read or as simulated", "in the lesion's edge"
ATTENUATION, LIVER = "in the attenuation of liver", "in the moduli of liver"
LESION, DOSE = "in the moduli of the lesion", "in the dose that coagulates"
FIELDS = {FOCUS: "", ATTENUATION: "attenuation", LIVER: "liver_modulus", LESION: "lesion_modulus", DOSE: "threshold"}


class Wave(HmiCause):
    """A field of the tissue follows a wave along temperature, or the thermometer is off by one."""

    name, place, unit, sign, plausible = "wave", "anywhere", "1", 0, 1.0
    sentence = helps = source = ""
    field: str = eqx.field(static=True)

    @staticmethod
    def wave(conditions):
        x = (conditions.temperature - TEMPERATURES.min()) / np.ptp(TEMPERATURES)
        inside = jnp.arange(len(x)) < len(x) - 1
        return np.exp(-0.25 * (2.0 * np.pi * COARSE) ** 2) * jnp.cos(2.0 * np.pi * x) * inside

    def temperature(self, temperature, conditions, strength, shape):
        return temperature if self.field else temperature + strength * self.wave(conditions)

    def tissue(self, change, conditions, model, strength, shape):
        if not self.field:
            return change
        factor = 1.0 + strength * self.wave(conditions)
        return eqx.tree_at(lambda tree: getattr(tree, self.field), change, getattr(change, self.field) * factor)


def test_a_wave_in_a_link_does_what_its_slopes_say(problem):
    """To a ten-thousandth of it: the derivative of the chain along the wave, and nothing of one state in another."""
    slopes = slopes_of_links(problem, problem.program.null())
    wave, coldest = process(TEMPERATURES, COARSE)[:, [2]], links._coldest_of_course(problem)
    program = problem.program.with_causes([Wave(field) for field in FIELDS.values()])
    made = program.slopes(program.null(), range(len(FIELDS)))
    for column, words in enumerate(FIELDS):
        told = (slopes[words][:, :1] * wave + slopes[words][:, 1:] * wave[coldest])[:, 0]
        largest = np.max(np.abs(made[:, column]))
        assert largest > 1e-3
        np.testing.assert_allclose(told, made[:, column], atol=1e-4 * largest, err_msg=words)


def test_programs_of_other_causes_are_compiled_once(problem):
    causes = (Wave(""),)
    one, other = problem.program.with_causes(causes), problem.program.on(problem.program.courses).with_causes(causes)
    assert one is not problem.program and one.causes == causes
    assert one._predict is other._predict and one._predict is not problem.program._predict


@pytest.mark.parametrize(
    ("cause", "links_of_it", "not_of_it"),
    [
        ("lesion-rim", {EDGE}, {LIVER, ATTENUATION}),
        ("damage-law", {EDGE, DOSE}, {LIVER, ATTENUATION}),
    ],
)
def test_what_is_hidden_in_a_link_is_taken_by_it(problem, cause, links_of_it, not_of_it):
    """Two of which it is so. A smooth effect in the lesion's moduli is not told from one in the liver's (docs)."""
    hidden, _ = measured_with(problem, cause, 1.0, noise=0.003, seed=14)
    null = fit_hmi(hidden, (), white(hidden), size=0.003)
    found = HmiAccount(hidden, null, seed=1).links()
    share = {one.words: one.share for one in found}
    assert [one.share for one in found] == sorted(share.values(), reverse=True)
    assert max(share[one] for one in links_of_it) > 0.95 * found[0].share > 0.4
    assert all(share[one] < 0.75 * found[0].share for one in not_of_it)
    assert min(one.p_family for one in found) < 0.05


def test_what_links_take_is_drawn_with_the_seed_of_the_diagnosis(problem):
    null = fit_hmi(problem, (), white(problem), size=0.003)
    first, again, other = ([one.p_family for one in HmiAccount(problem, null, seed=seed).links()] for seed in (1, 1, 2))
    assert first == again != other


def test_corrections_of_links_are_weighed_as_readings_are(problem, monkeypatch):
    """Of a reading with five times the deviation a fifth is felt; of what is believed of constants nothing."""
    asked, count = [], len(problem.rows)

    def spied(_, forms, __):
        asked.append({form.name: form.directions for form in forms})
        raise InterruptedError

    monkeypatch.setattr(links, "Screen", spied)
    deviation = np.where(np.arange(count) % 3 == 0, 0.05, 0.01)
    for given in (np.ones(count), deviation):
        of_it = dataclasses.replace(problem, rows=dataclasses.replace(problem.rows, deviation=given))
        null = bare(HmiFit, problem=of_it, unknowns=problem.program.null(), residuals=np.zeros(count + 2),
                    directions=np.zeros((count + 2, 1)))  # fmt: skip
        with pytest.raises(InterruptedError):
            links.absorbed_by_links(null, of_it.noise_family(), np.random.default_rng(0))
    plain, weighed = asked
    assert list(plain) == list(links._LINKS)
    for words, directions in weighed.items():
        np.testing.assert_allclose(directions[:count], plain[words][:count] / deviation[:, None], rtol=1e-12)
        assert np.any(directions) and not np.any(directions[count:])
