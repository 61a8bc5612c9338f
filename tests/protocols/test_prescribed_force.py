"""Forces in liver that is the same everywhere: responses, the Gaussian beam, the map over stiffness and attenuation."""

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import (
    GaussianBeam,
    InputError,
    ShearModulus,
    YoungModulus,
    discretise,
    displacement_map,
    focal_response,
    read_experiment,
    solve_push,
)
from arfjax.protocols.heated_tissue import push_material
from arfjax.protocols.homogeneous import force_of_attenuation, homogeneous_material
from arfjax.protocols.stepwise import force_at, push
from arfjax.units import from_db_per_cm

EXPERIMENT = Path(__file__).parents[2] / "examples" / "suomi2016.toml"
REFERENCE = Path(__file__).parents[1] / "reference" / "mechanics" / "homogeneous_push.npz"
PAPERS = GaussianBeam.of_widths(1.4e-3, 9e-3)


@pytest.fixture(scope="module")
def described():
    return read_experiment(EXPERIMENT)


@pytest.fixture(scope="module")
def model(described):
    return described.model_at(1.0)


@pytest.fixture(scope="module")
def protocol(described):
    return described.stepwise()


@pytest.fixture(scope="module")
def settings(model):
    return discretise(model)


@pytest.fixture(scope="module")
def response(protocol, settings):
    return jax.jit(lambda material: focal_response(material, protocol, settings))


def test_widths_are_where_a_quarter_is_left():
    assert PAPERS.radius == pytest.approx(0.5945e-3, abs=1e-7)
    assert PAPERS.length == pytest.approx(3.822e-3, abs=1e-6)
    np.testing.assert_allclose(np.exp(-((0.7e-3 / PAPERS.radius) ** 2)), 0.25, rtol=1e-12)


def test_millimetres_are_refused():
    with pytest.raises(InputError, match="Millimetres"):
        GaussianBeam.of_widths(1.4, 9.0)


def test_millimetres_in_arrays_are_refused():
    with pytest.raises(InputError, match="Millimetres"):
        GaussianBeam(jnp.asarray(1.0), 8e-3)


def test_force_is_two_alpha_i_over_c_after_its_path(model, settings):
    """At the focus, by hand: alpha = 0.35 dB/cm at 1 MHz times the polynomial and 1.1, over 20 mm."""
    beam = dataclasses.replace(PAPERS, intensity=1e7)
    force = np.asarray(beam.force_density(model, jnp.asarray(55.0), mesh=settings.mesh, focus=settings.focus))
    polynomial = 123.0 + 1.99 * 55 - 0.141 * 55**2 + 1.94e-3 * 55**3 - 2.55e-6 * 55**4
    alpha = 0.35 * 100.0 / 8.685889638 * 1e-2 * polynomial * 1.1
    expected = 2.0 * alpha * 1e7 * np.exp(-2.0 * alpha * 0.02) / 1584.0
    r, z = settings.mesh.gauss_r, settings.mesh.gauss_z
    shape = np.exp(-((r[:, None] / PAPERS.radius) ** 2) - ((z[None, :] - settings.focus) / PAPERS.length) ** 2)
    np.testing.assert_allclose(force, expected * shape, rtol=1e-6)


@pytest.mark.slow
def test_a_response_holds_every_push(model, protocol, settings, response):
    """Sum of response and force is the displacement of a push, with a lesion and for any force, to rounding."""
    rng = np.random.default_rng(1)
    share = jnp.asarray(rng.uniform(size=(len(settings.mesh.gauss_r), len(settings.mesh.gauss_z))))
    force = jnp.asarray(rng.normal(size=share.shape))
    at = jnp.asarray(65.0)
    weights = response(jax.jit(push_material)(jax.tree.map(jnp.asarray, model), at, share))
    pushed = jax.jit(lambda at, force: push(model, at, share, force, protocol, settings).at_focus(settings.focus)[-1])
    np.testing.assert_allclose(jnp.vdot(weights, force), pushed(at, force), rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("reading", "name"), [(YoungModulus(), "E"), (ShearModulus(), "G")])
def test_homogeneous_liver_in_closed_form(model, settings, response, reading, name):
    """An infinite Zener solid under the Gaussian force, for moduli from 5 to 155 kPa, to the accuracy of the mesh."""
    stored = dict(np.load(REFERENCE))
    chosen = dataclasses.replace(model, modulus_reading=reading)
    profile = np.exp(
        -((settings.mesh.gauss_r[:, None] / float(stored["a"])) ** 2)
        - ((settings.mesh.gauss_z[None, :] - settings.focus) / float(stored["b"])) ** 2
    )
    for modulus, expected in zip(stored["Es"], stored[f"u_per_unit_force_reading{name}"], strict=True):
        if modulus < 5e3:
            continue
        material = homogeneous_material(chosen, float(modulus), settings, temperature=jnp.asarray(35.0))
        assert float(jnp.vdot(response(material), profile)) == pytest.approx(float(expected), rel=5e-3), modulus


def test_liver_of_its_own_attenuation_is_liver(model, protocol, settings):
    own = model.liver.attenuation(35.0)
    prescribed, usual = jax.jit(
        lambda alpha: (
            force_of_attenuation(model, alpha, protocol, settings),
            force_at(model, 35.0, protocol, settings),
        )
    )(own)
    np.testing.assert_allclose(prescribed, usual, rtol=1e-10, atol=1e-10 * float(jnp.max(usual)))


@pytest.mark.slow
def test_the_map_is_made_of_single_pushes(model, protocol, settings):
    """To 1e-9 at some of its points, and it rises with attenuation at first and falls with stiffness everywhere."""
    moduli, alphas = np.asarray([5e3, 30e3, 155e3]), from_db_per_cm(1.0) * np.asarray([0.15, 0.35, 0.8, 1.35])
    found = np.asarray(jax.jit(lambda m, a: displacement_map(model, m, a, protocol, settings))(moduli, alphas))

    @jax.jit
    def pushed(modulus, alpha):
        material = homogeneous_material(model, modulus, settings, temperature=protocol.start_temperature)
        force = force_of_attenuation(model, alpha, protocol, settings)
        steps = settings.push_steps(protocol.push_duration)
        return solve_push(settings.mesh, material, force, settings=steps).at_focus(settings.focus)[-1]

    for row, column in ((0, 0), (1, 1), (2, 3), (0, 3)):
        assert found[row, column] == pytest.approx(float(pushed(moduli[row], alphas[column])), rel=1e-9)
    assert np.all(np.diff(found, axis=0) < 0.0) and np.all(found[:, 1] > found[:, 0])
