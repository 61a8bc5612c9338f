"""Settings refined by what a solution says of itself, and whether it is true."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics import converge
from arfjax.acoustics.converge import refined, solve_to_tolerance
from arfjax.acoustics.field import Convergence
from arfjax.acoustics.layers import AcousticLayer
from arfjax.acoustics.one_way import solve_field
from arfjax.acoustics.settings import MarchSettings
from arfjax.acoustics.sources.gaussian import GaussianSource
from arfjax.acoustics.variation import MediumVariation
from arfjax.errors import InputError
from arfjax.media import AcousticMedium
from arfjax.numerics.hankel import hankel_basis
from arfjax.transducer import PressureDrive

LIVER = AcousticMedium(1060.0, 1584.0, 4.0, 1.1, 7.2)
BEAM = GaussianSource(radius=4e-3, focal_length=25e-3)
START = MarchSettings(n_harmonics=8, n_radial=80, domain_radius=20e-3, axial_step=2e-3)
SETTINGS = MarchSettings(n_harmonics=16)
LINEAR = MarchSettings(n_radial=48, domain_radius=20e-3, sponge_start=0.95, sponge_strength=0.0)


def found(harmonics=0.0, radial=0.0, axial=0.0, shock_fraction=0.0, courant_number=0.1):
    return Convergence(*map(jnp.asarray, (harmonics, radial, axial, shock_fraction, courant_number)))


def changed(settings, better):
    fields = (each.name for each in dataclasses.fields(settings))
    return {name: getattr(better, name) for name in fields if getattr(better, name) != getattr(settings, name)}


def test_what_is_good_enough_stays():
    assert refined(SETTINGS, found(1e-3, 1e-3, 1e-3, 0.5, 0.65), 1e-3) == SETTINGS


@pytest.mark.parametrize(
    ("estimates", "expected"),
    [
        ({"harmonics": 2e-3}, {"n_harmonics": 24}),
        ({"radial": 2e-3}, {"n_radial": 320}),
        ({"axial": 4e-3}, {"axial_step": 0.34e-3 * 0.5}),  # 0.9 / 2, but not below a half at once
        ({"axial": 2e-3}, {"axial_step": 0.34e-3 * 0.9 / np.sqrt(2.0)}),
        ({"axial": 1.01e-3}, {"axial_step": 0.34e-3 * 0.8}),
        ({"courant_number": 2.7}, {"n_substeps": 5}),
        ({"harmonics": 2e-3, "courant_number": 1.2}, {"n_harmonics": 24, "n_substeps": 3}),
        ({"harmonics": np.nan}, {"n_harmonics": 24}),
        ({"radial": np.nan}, {"n_radial": 320}),
        ({"axial": np.nan}, {"axial_step": 0.17e-3}),
        ({"courant_number": np.nan}, {"n_substeps": 2}),
        ({"courant_number": np.inf}, {"n_substeps": 2}),
        # Of a march that was not stable no other estimate says anything.
        ({"courant_number": np.nan, "harmonics": np.nan, "radial": np.nan, "axial": np.nan}, {"n_substeps": 2}),
    ],
)
def test_each_estimate_refines_what_it_is_of(estimates, expected):
    changes = changed(SETTINGS, refined(SETTINGS, found(**estimates), 1e-3))
    assert changes.keys() == expected.keys()
    np.testing.assert_allclose(list(changes.values()), [expected[name] for name in changes], rtol=1e-12)


def test_substeps_that_are_not_needed_are_given_back():
    many = dataclasses.replace(SETTINGS, n_substeps=8)
    assert changed(many, refined(many, found(courant_number=0.3), 1e-3)) == {"n_substeps": 4}


def test_what_cannot_be_refined_is_left():
    most = MarchSettings(n_harmonics=256, n_radial=1600)
    assert refined(most, found(harmonics=1.0, radial=1.0), 1e-3) == most
    linear = MarchSettings()
    assert refined(linear, found(harmonics=1.0, courant_number=9.0), 1e-3) == linear


def test_what_falls_short_is_said():
    assert found(1e-3, 1e-3, 1e-3).shortcoming(1e-3) == ""
    for estimates, remedy in (
        ({"harmonics": 2e-3}, "n_harmonics"),
        ({"radial": 2e-3}, "n_radial"),
        ({"axial": 2e-3}, "axial_step"),
        ({"courant_number": 2.9}, "n_substeps"),
    ):
        for value in (estimates, dict.fromkeys(estimates, np.nan)):
            said = found(**value).shortcoming(1e-3)
            assert f"`{remedy}`" in said
            assert said.count("`") == 2
    assert found(np.nan, np.nan, np.nan, 0.0, np.nan).shortcoming(1e-3).count("; ") == 3
    np.testing.assert_allclose(found(1e-3, 2e-3, 4e-3).error, 7e-3)


@pytest.mark.parametrize("tolerance", [0.0, -1e-3, 1e-5, 0.2, np.nan])
def test_a_tolerance_that_cannot_be_meant_is_refused(tolerance):
    with pytest.raises(InputError, match="`tolerance` must lie between"):
        solve_to_tolerance(
            BEAM,
            PressureDrive(1.1e6, 1e6),
            [AcousticLayer(LIVER, 0.05)],
            r=np.zeros(1),
            z=np.array([0.03]),
            tolerance=tolerance,
        )


def solved(tolerance, pressure=2e6, settings=START, variation=None):
    said = []
    z = np.array([15e-3, 30e-3])
    field, settings = solve_to_tolerance(
        BEAM,
        PressureDrive(1.1e6, pressure),
        [AcousticLayer(LIVER, 0.05)],
        r=np.zeros(1),
        z=z,
        tolerance=tolerance,
        settings=settings,
        variation=variation,
        say=said.append,
    )
    return field, settings, said


def test_without_power_nothing_is_in_error():
    """And no search for better settings begins."""
    silent = PressureDrive(1.1e6, 0.0)
    where = {"r": np.zeros(1), "z": np.array([15e-3, 30e-3]), "settings": START}
    convergence = jax.jit(lambda: solve_field(BEAM, silent, [AcousticLayer(LIVER, 0.05)], **where).convergence)()
    assert convergence.shortcoming(1e-3) == ""
    assert float(convergence.error) == 0.0
    assert refined(START, convergence, 1e-3) == START


def test_the_axial_estimate_is_the_axial_error():
    """Of linear sound through a warm spot, where the step alone errs: Richardson's estimate has the error's h^2.

    Its h^4, and what the finest steps still err by, are below a tenth of that.
    """
    r, z, end = np.linspace(0.5e-3, 19.5e-3, 20), np.linspace(2e-3, 38e-3, 19), 40e-3
    spot = jnp.asarray(np.exp(-((r[:, None] / 3e-3) ** 2) - ((z - 20e-3) / 6e-3) ** 2))
    warm = MediumVariation(r, z, 5.0 * spot, 60.0 * spot)
    basis = hankel_basis(LINEAR.n_radial, LINEAR.domain_radius)
    inside = basis.nodes < 18e-3

    def beam(axial_step):
        settings = dataclasses.replace(LINEAR, axial_step=axial_step)
        where = {"r": basis.nodes[inside], "z": np.array([end]), "settings": settings, "variation": warm}

        @jax.jit
        def solve():
            field = solve_field(BEAM, PressureDrive(1.1e6, 1.0), [AcousticLayer(LIVER, 0.05)], **where)
            return field.pressure[0, :, 0], field.convergence.axial

        return solve()

    def norm(pressure):
        return np.sqrt(basis.weights[inside] @ np.abs(pressure) ** 2)

    exact, _ = beam(end / 1280)
    for n_steps in (80, 160):
        pressure, estimate = beam(end / n_steps)
        np.testing.assert_allclose(estimate, norm(pressure - exact) / norm(exact), rtol=0.1)


@pytest.mark.slow
def test_the_tolerance_is_reached_in_truth():
    tolerance = 1e-4
    field, settings, said = solved(tolerance)
    assert field.convergence.shortcoming(tolerance) == ""
    assert settings.axial_step < START.axial_step and settings.n_harmonics > START.n_harmonics
    assert len(said) >= 3
    assert "harmonics" in said[0]
    finest = MarchSettings(n_harmonics=48, n_radial=128, domain_radius=20e-3, axial_step=0.1e-3)
    exact, same, _ = solved(1e-1, settings=finest)
    assert same == finest
    error = np.zeros((48, 2), complex)
    error[: settings.n_harmonics] = field.pressure[:, 0]
    error -= np.asarray(exact.pressure[:, 0])
    sizes = np.linalg.norm(error, axis=0) / np.linalg.norm(exact.pressure[:, 0], axis=0)
    assert np.all(sizes < 3.0 * tolerance)  # each of three estimates is held below it
    # The estimate of the axial error is that error, within a factor of four.
    assert 0.25 < np.max(sizes) / float(field.convergence.axial) < 4.0


@pytest.mark.slow
def test_a_layer_that_varies_is_solved_as_it_is():
    r, z = np.array([1e-3, 5e-3, 30e-3]), np.array([5e-3, 25e-3, 45e-3])
    changes = MediumVariation(r, z, jnp.full((3, 3), 2.0), jnp.full((3, 3), 15.0))
    field, settings, _ = solved(1e-1, pressure=1e5, variation=changes)

    @functools.partial(jax.jit, static_argnums=1)
    def pressure(amplitude, varies):
        options = {"r": np.zeros(1), "z": np.array([15e-3, 30e-3]), "settings": settings}
        layers, varied = [AcousticLayer(LIVER, 0.05)], changes if varies else None
        return solve_field(BEAM, PressureDrive(1.1e6, amplitude), layers, variation=varied, **options).pressure

    np.testing.assert_allclose(field.pressure, pressure(1e5, True), rtol=1e-9, atol=1e-5)
    assert np.abs(field.pressure - pressure(1e5, False)).max() > 0.05 * np.abs(field.pressure).max()


@pytest.mark.slow
def test_a_shock_that_cannot_be_resolved_is_said(monkeypatch):
    monkeypatch.setattr(converge, "_HARMONICS", (8,))
    field, settings, _ = solved(5e-3, pressure=8e6, settings=dataclasses.replace(START, axial_step=1e-3))
    assert settings.n_harmonics == 8
    assert "raise `n_harmonics`" in field.convergence.shortcoming(5e-3)
    assert np.all(np.isfinite(field.pressure))
