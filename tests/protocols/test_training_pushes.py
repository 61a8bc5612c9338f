"""What a fast curve learns from a push of the full solid."""

import jax.numpy as jnp
import numpy as np

from arfjax import discretise, read_experiment
from arfjax.media import Prony
from arfjax.protocols.fast_curve import FastCurve
from arfjax.protocols.fast_preparation import _no_box, _no_solid
from arfjax.protocols.fast_training import push_of
from arfjax.protocols.sound_table import Interval, SoundTable
from tests.experiment_files import EXAMPLE


def even(shape):
    """Sound that heats or pushes alike everywhere, whatever the liver is."""
    anywhere = Interval(0.0, 1.0, 1)
    return SoundTable(anywhere, anywhere, heat=jnp.full((1, 1, *shape), 1e5), force=jnp.zeros((1, 1, 0)))


def test_moduli_are_those_half_way_through_the_push():
    """Of the paper's Zener solid at 60 degC, whose moduli are Young's."""
    described = read_experiment(EXAMPLE)
    model, protocol = described.model(), described.stepwise()
    settings = discretise(model, refinement=0.3)
    fast = FastCurve(model, even(settings.heat_grid.shape), _no_solid(), _no_box(), settings, True)
    mesh = settings.mesh
    forces = even((len(mesh.gauss_r), len(mesh.gauss_z)))
    pushed = push_of(fast, protocol, forces, mesh, 1)(model, jnp.asarray(60.0))

    zener = model.liver.viscoelasticity(60.0)
    branch = jnp.asarray([zener.unrelaxed_modulus - zener.relaxed_modulus]), jnp.asarray([zener.relaxation_time])
    half_way = Prony(zener.relaxed_modulus, *branch).relaxation_modulus(0.5 * protocol.push_duration)
    np.testing.assert_allclose(pushed.liver[0], half_way / (2.0 * (1.0 + model.poisson_ratio)), rtol=1e-12)
    np.testing.assert_allclose(pushed.liver[2], model.liver.density(60.0), rtol=1e-12)
