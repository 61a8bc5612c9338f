"""Grids and steps follow the geometry: from one frequency, aperture or length of push to twice it."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from arfjax import InputError, discretise, read_experiment
from arfjax.acoustics.settings import MarchSettings
from arfjax.protocols.discretisation import march_settings
from arfjax.transducer import FocusedBowl

MODEL = read_experiment(Path(__file__).parents[2] / "examples" / "suomi2016.toml").model()
DEFAULT = MarchSettings()


def scaled(frequency=1.0, aperture=1.0, focal_length=1.0):
    """The paper's model with so many times its frequency, aperture and focal length."""
    bowl, drive = MODEL.bowl, MODEL.drive
    bowl = FocusedBowl(aperture * bowl.aperture_radius, bowl.hole_radius, focal_length * bowl.focal_length)
    return dataclasses.replace(
        MODEL, bowl=bowl, drive=dataclasses.replace(drive, frequency=frequency * drive.frequency)
    )


@pytest.mark.parametrize(("frequency", "finer"), [(0.5, 1.0), (1.0, 1.0), (2.0, 2.0)])
def test_the_march_takes_as_many_steps_a_wavelength_at_a_higher_frequency(frequency, finer):
    """And as many terms and points a wavelength across the bowl; at a lower one it stays as it is."""
    march = march_settings(scaled(frequency))
    np.testing.assert_allclose(march.axial_step, DEFAULT.axial_step / finer, rtol=1e-14)
    assert (march.n_radial, march.n_quadrature) == (finer * DEFAULT.n_radial, finer * DEFAULT.n_quadrature)
    assert march.domain_radius == DEFAULT.domain_radius


def test_a_bowl_twice_as_wide_has_twice_the_domain_with_the_spacing_of_before():
    march = march_settings(scaled(aperture=2.0, focal_length=2.0))
    np.testing.assert_allclose(march.domain_radius, 2.0 * DEFAULT.domain_radius, rtol=1e-14)
    assert (march.n_radial, march.n_quadrature) == (2 * DEFAULT.n_radial, 2 * DEFAULT.n_quadrature)
    assert march.axial_step == DEFAULT.axial_step


def test_refinement_divides_the_march_s_spacings():
    march = march_settings(MODEL, 2.0)
    assert (march.axial_step, march.n_radial) == (0.5 * DEFAULT.axial_step, 2 * DEFAULT.n_radial)


def finest(model):
    """Of the mesh and of the heat grid, next to the focus: across the beam and along it [m]."""
    settings = discretise(model)
    grid = settings.heat_grid
    across, along = (settings.mesh.r_edges, grid.r_faces), (settings.mesh.z_edges, grid.z_faces)
    return np.array([np.diff(edges).min() for edges in (*across, *along)])


def test_cells_at_the_focus_are_as_narrow_as_the_beam():
    """Which is as wide as wavelength times focal length over aperture; a wider one than the paper's asks for no more.

    Stretching to end at the walls changes the spacings by less than a cell of the coarsest in the whole length.
    """
    papers = finest(MODEL)
    np.testing.assert_allclose(finest(scaled(frequency=2.0)), 0.5 * papers, rtol=0.15)
    np.testing.assert_allclose(finest(scaled(frequency=2.0, aperture=0.5)), papers, rtol=1e-12)
    np.testing.assert_allclose(finest(scaled(aperture=0.5)), papers, rtol=1e-12)


@pytest.mark.parametrize(("duration", "times"), [(0.5e-3, 1), (1e-3, 2), (0.25e-3, 1), (0.51e-3, None)])
def test_a_longer_push_has_more_steps_and_none_is_longer(duration, times):
    settings = discretise(MODEL)
    steps = settings.push_steps(duration)
    assert steps.n_steps * steps.time_step == pytest.approx(duration, rel=1e-14) == steps.push_duration
    assert steps.time_step <= 0.5e-3 / settings.n_push_steps * (1.0 + 1e-9)
    assert times is None or steps.n_steps == times * settings.n_push_steps


@pytest.mark.parametrize("refinement", [0.0, -1.0, float("nan"), float("inf")])
def test_a_refinement_that_is_none_is_refused(refinement):
    with pytest.raises(InputError, match="`refinement` divides all spacings"):
        discretise(MODEL, refinement=refinement)
