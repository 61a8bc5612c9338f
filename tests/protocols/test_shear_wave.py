"""A push followed in liver: the wave runs at the tissue's shear-wave speed, and the push is the stepwise protocol's."""

from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import Heating, InputError, discretise, read_experiment, run_stepwise, simulate_heating
from arfjax.protocols.shear_wave import WatchSettings, watch_mesh, watch_push

EXPERIMENT = Path(__file__).parents[2] / "examples" / "suomi2016.toml"
WATCH = WatchSettings(duration=7e-3, radius=7e-3, half_length=8e-3, n_frames=20, element=0.35e-3)


@pytest.fixture(scope="module")
def watched():
    described = read_experiment(EXPERIMENT)
    model, protocol = described.model(), described.stepwise()
    settings = discretise(model, refinement=0.7)
    heating = eqx.filter_jit(lambda model: simulate_heating(model, protocol, settings))(model)
    degrees = jnp.asarray(40.0)  # traced: the lesion's law would warn, and there is no lesion

    def run(model, degrees):
        result = watch_push(model, degrees, protocol, settings, heating=heating, watch=WATCH)
        return result, run_stepwise(model, degrees[None], protocol, settings, heating=heating)

    return model, protocol, *eqx.filter_jit(run)(model, degrees)


@pytest.mark.slow
def test_the_wave_runs_at_the_shear_wave_speed(watched):
    """Unrelaxed, because the wave passes in a hundredth of the relaxation time; 3 % for a source of finite width."""
    model, _, result, _ = watched
    solid = model.liver.viscoelasticity(40.0)
    shear = solid.unrelaxed_modulus / (2.0 * (1.0 + model.poisson_ratio))
    speed = np.sqrt(shear / model.liver.density(40.0))
    np.testing.assert_allclose(result.speed, speed, rtol=0.03)
    arrived = np.isfinite(np.asarray(result.arrival))
    assert arrived.sum() >= 8 and not arrived[0]
    assert np.all(np.diff(np.asarray(result.arrival)[arrived]) > 0.0)


@pytest.mark.slow
def test_the_push_itself_is_that_of_the_stepwise_protocol(watched):
    _, protocol, result, steps = watched
    at_end = np.interp(protocol.push_duration, result.focal_time, result.focal_displacement)
    np.testing.assert_allclose(at_end, float(steps.displacement[0]), rtol=1e-2)
    row = int(np.argmin(np.abs(np.asarray(result.z) - model_focus(result))))
    frame = int(np.argmin(np.abs(np.asarray(result.time) - 3.5e-3)))
    course = np.interp(result.time[frame], result.focal_time, result.focal_displacement)
    np.testing.assert_allclose(result.displacement[frame, 0, row], course, rtol=2e-2)
    np.testing.assert_array_equal(result.displacement[0], 0.0)


@pytest.mark.slow
def test_strain_is_that_of_the_displacement_and_keeps_the_volume(watched):
    """Nearly incompressible tissue strains in shape alone; what is left is the difference quotients' error."""
    _, _, result, _ = watched
    strain, frame = np.asarray(result.strain), int(np.argmin(np.abs(np.asarray(result.time) - 1e-3)))
    assert strain.shape == (*result.displacement.shape, 4)
    coarse = np.gradient(np.asarray(result.displacement[frame]), result.z, axis=1)
    largest = np.max(np.abs(strain[frame]))
    np.testing.assert_allclose(strain[frame, :, 2:-2, 1], coarse[:, 2:-2], atol=0.05 * largest)
    assert np.max(np.abs(strain[frame, ..., :3].sum(axis=-1))) < 0.05 * largest


def model_focus(result):
    """The bowl's focal length, which the maps contain as a node."""
    assert np.any(np.isclose(result.z, 62.6e-3, atol=1e-9))
    return 62.6e-3


def test_the_mesh_is_even_as_far_as_the_wave_is_followed():
    described = read_experiment(EXPERIMENT)
    settings = discretise(described.model(), refinement=0.5)
    mesh = watch_mesh(settings, WATCH)
    even = np.diff(mesh.r_edges)[mesh.r_edges[1:] <= WATCH.radius + 1e-9]
    np.testing.assert_allclose(even, WATCH.element, rtol=0.03)
    assert mesh.r_edges[-1] == settings.mesh.r_edges[-1] and np.any(np.isclose(mesh.z_edges, settings.focus))


@pytest.mark.parametrize(
    "changes", [{"duration": 0.0}, {"radius": -1.0}, {"element": np.nan}, {"n_frames": 3}, {"radius": 30e-3}]
)
def test_what_cannot_be_followed_is_refused(changes):
    with pytest.raises(InputError):
        WatchSettings(**changes)


def test_a_push_longer_than_it_is_followed_is_refused():
    described = read_experiment(EXPERIMENT)
    model, protocol = described.model(), described.stepwise()
    settings, watch = discretise(model, refinement=0.5), WatchSettings(duration=0.2e-3)
    nothing = Heating(*(jnp.zeros(1),) * 2, *(jnp.zeros((1, 1, 1)),) * 2, jnp.zeros(()))
    with pytest.raises(InputError, match="longer than it is watched"):
        watch_push(model, 40.0, protocol, settings, heating=nothing, watch=watch)
