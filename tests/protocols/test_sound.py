"""Protocols with another sound field than the linear one: heat and force of all harmonics, other operators."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics import converge
from arfjax.acoustics.diffraction import Pade11, Parabolic
from arfjax.acoustics.intensity import heat_deposition, radiation_force_density
from arfjax.acoustics.one_way import solve_field
from arfjax.acoustics.settings import MarchSettings
from arfjax.acoustics.sources.projected_bowl import ProjectedBowl
from arfjax.experiment import acoustics as module
from arfjax.experiment import read_experiment
from arfjax.experiment.acoustics import AcousticsSection
from arfjax.model import Layer
from arfjax.protocols.discretisation import discretise, layers_at
from arfjax.protocols.sonication import Sonication, sonication_field
from arfjax.protocols.stepwise import StepwiseProtocol, force_at
from arfjax.thermal.bioheat import Phase
from tests.acoustics.test_waveform import field_of
from tests.test_experiment import EXAMPLE

PAPERS = read_experiment(EXAMPLE).model()
# Water and liver alone: every layer more takes as long again to compile.
MODEL = dataclasses.replace(PAPERS, path=(Layer(PAPERS.path[0].tissue, PAPERS.liver_depth),))
PROTOCOL = StepwiseProtocol(start_temperature=37.0)
COARSE = MarchSettings(n_harmonics=8, n_radial=144, axial_step=2e-3, start_plane=12e-3)
SETTINGS = dataclasses.replace(discretise(MODEL, refinement=0.3), march=COARSE)
LINEAR = dataclasses.replace(SETTINGS, march=dataclasses.replace(COARSE, n_harmonics=1))


def force_of(settings):
    return np.asarray(eqx.filter_jit(lambda model: force_at(model, 37.0, PROTOCOL, settings))(MODEL))


def hottest(settings):
    """Of a sonication's field in tissue that is not heated yet, through the operator for heated tissue."""
    grid, plan = settings.heat_grid, Sonication((Phase(1.0, 2),), 37.0, 2.0)
    warm = jnp.full(grid.shape, 37.0)
    solve = eqx.filter_jit(
        lambda model: heat_deposition(sonication_field(model, plan, settings, warm, 0.0 * warm, r=grid.r[:1], z=grid.z))
    )
    return float(np.max(solve(MODEL)))


@pytest.mark.slow
def test_heat_and_force_are_those_of_all_harmonics():
    """At 50 W the second harmonic has a twentieth of the energy, and is absorbed twice as much."""
    assert 1.04 < np.max(force_of(SETTINGS)) / np.max(force_of(LINEAR)) < 1.5
    assert 1.04 < hottest(SETTINGS) / hottest(LINEAR) < 1.5


def test_other_operators_and_sources_reach_the_field():
    plane, mesh = float(MODEL.bowl.rim_depth), SETTINGS.mesh
    settings = dataclasses.replace(LINEAR, diffraction=Parabolic(), source_plane=plane)
    direct = eqx.filter_jit(
        lambda model: radiation_force_density(
            solve_field(
                ProjectedBowl(model.bowl, plane),
                model.drive,
                layers_at(model, 37.0, 37.0),
                r=mesh.gauss_r,
                z=mesh.gauss_z,
                diffraction=Parabolic(),
                settings=LINEAR.march,
            )
        )
    )
    np.testing.assert_allclose(force_of(settings), direct(MODEL), rtol=1e-10, atol=1e-6)
    assert not np.allclose(force_of(settings), force_of(LINEAR), rtol=0.01)


def test_steps_are_chosen_for_harmonics_that_are_asked_for(monkeypatch):
    """With a march that makes errors as one of second order does, and never has enough harmonics."""
    template, said = field_of(np.ones((8, 1, 1))), []

    def marched(source, drive, layers, *, settings, **others):
        step = settings.axial_step
        made = dict(harmonics=jnp.asarray(0.5), axial=jnp.asarray(0.01 * (step / 2e-3) ** 2))
        made["courant_number"] = jnp.asarray(3.0 * step / 2e-3 / settings.n_substeps)
        return dataclasses.replace(template, convergence=dataclasses.replace(template.convergence, **made))

    monkeypatch.setattr(converge, "solve_field", marched)
    monkeypatch.setattr(module, "discretise", lambda model: dataclasses.replace(SETTINGS, march=COARSE))
    field, settings = AcousticsSection(tolerance=1e-3, harmonics=8).solve(
        MODEL, 37.0, r=np.zeros(1), z=np.array([60e-3, 62.6e-3]), say=said.append
    )
    assert settings.march.n_harmonics == 8 and settings.march.n_radial == COARSE.n_radial
    assert 0.4e-3 < settings.march.axial_step < 0.64e-3
    assert "harmonics end too early" in field.convergence.shortcoming(1e-3)
    assert settings.shortcoming == field.convergence.shortcoming(1e-3)
    assert said[-1] == "the field at 1 x 2 positions with 8 harmonics"


@pytest.mark.parametrize(("given", "nonlinear", "n_harmonics"), [(None, True, 16), (None, False, 1), (False, True, 1)])
def test_harmonics_that_are_not_asked_for_are_chosen(monkeypatch, given, nonlinear, n_harmonics):
    asked, template = {}, field_of(np.ones((4, 1, 1)))

    def chosen(source, drive, layers, **options):
        asked.update(options, source=source)
        return template, dataclasses.replace(options["settings"], n_radial=300)

    monkeypatch.setattr(module, "solve_to_tolerance", chosen)
    acoustics = AcousticsSection(nonlinear=given, tolerance=1e-4, diffraction="pade11", source="projected")
    field, settings = acoustics.solve(MODEL, 37.0, r=np.zeros(1), z=np.array([60e-3]), nonlinear=nonlinear)
    assert field is template and settings.march.n_radial == 300
    assert (asked["settings"].n_harmonics, asked["tolerance"]) == (n_harmonics, 1e-4)
    assert isinstance(asked["source"], ProjectedBowl) and isinstance(asked["diffraction"], Pade11)
    # For a protocol linear sound is left as it is.
    settings = acoustics.discretise(MODEL, 37.0, nonlinear=nonlinear)
    assert settings.march.n_radial == (256 if n_harmonics == 1 else 300)
