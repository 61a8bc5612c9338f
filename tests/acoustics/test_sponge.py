"""The absorbing ring: what it takes, when it acts, and that it is not felt inside."""

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics.diffraction import ExactOneWay
from arfjax.acoustics.layers import AcousticLayer
from arfjax.acoustics.march import Beam, march
from arfjax.acoustics.one_way import solve_field
from arfjax.acoustics.settings import MarchSettings
from arfjax.acoustics.sponge import Sponge, absorbing_ring, sponge_depth
from arfjax.media import AcousticMedium
from arfjax.numerics.hankel import hankel_basis
from arfjax.transducer import Drive, FocusedBowl

BASIS = hankel_basis(144, 62e-3)
COARSE = MarchSettings(n_radial=144)
WAVENUMBER = 2.0 * np.pi * 1.1e6 / 1482.0


@pytest.mark.parametrize("lengths", [np.full(300, 0.34e-3), np.array([5e-3, 1e-6, 0.4e-3, 0.4e-3, 0.4e-3]), [1e-3]])
def test_passes_cover_the_whole_way_and_keep_their_distance(lengths):
    lengths, sponge = np.asarray(lengths), absorbing_ring(BASIS, COARSE)
    passes = sponge.pass_lengths(lengths)
    np.testing.assert_allclose(passes.sum(), lengths.sum(), rtol=1e-12)
    assert passes[-1] > 0.0 and np.all(passes >= 0.0)
    # None waits longer than its spacing and the step in which it falls due.
    assert passes.max() < sponge.spacing + lengths.max()
    if len(lengths) > 100:
        assert np.count_nonzero(passes) < 0.4 * len(lengths)


def test_nodes_are_clean_or_in_the_ring():
    sponge, depth = absorbing_ring(BASIS, COARSE), sponge_depth(BASIS, COARSE)
    assert sponge.n_clean + len(sponge.loss) == len(BASIS.nodes)
    assert BASIS.nodes[sponge.n_clean - 1] <= 0.55 * 62e-3 < BASIS.nodes[sponge.n_clean]
    np.testing.assert_array_equal(depth > 0.0, np.arange(len(depth)) >= sponge.n_clean)
    assert np.all(np.diff(sponge.loss) >= 0.0)
    np.testing.assert_allclose(sponge.loss[-1], 400.0 / 62e-3, rtol=1e-12)


def power_along(sponge):
    """Of a Gaussian beam of 4 mm, which spreads into the ring, every 0.33 mm over 100 mm."""
    kz = ExactOneWay().axial_wavenumber(jnp.asarray([WAVENUMBER + 0j]), jnp.asarray(BASIS.wavenumbers))
    start = jnp.asarray(BASIS.to_series @ np.exp(-((BASIS.nodes / 4e-3) ** 2)) + 0j)[:, None]
    marched = march(
        Beam(start, None),
        np.linspace(0.0, 100e-3, 300),
        np.ones(300, dtype=bool),
        axial_wavenumber=kz,
        path=None,
        basis=BASIS,
        evaluation=jnp.eye(144),  # the coefficients themselves
        sponge=sponge,
    )
    return np.sum(BASIS.norms * np.asarray(kz.real[0]) * np.abs(np.asarray(marched.pressure[..., 0])) ** 2, axis=1)


def test_power_is_kept_without_a_ring_and_falls_with_one():
    kept = power_along(None)
    np.testing.assert_allclose(kept, kept[0], rtol=1e-8)
    n_clean = int(np.count_nonzero(BASIS.nodes <= 10e-3))
    lost = power_along(Sponge(n_clean, np.full(144 - n_clean, 100.0), 1e-3))
    np.testing.assert_allclose(lost[:3], lost[0], rtol=1e-3)
    assert np.all(np.diff(lost) <= 1e-9 * lost[0])
    assert lost[-1] < 0.9 * lost[0]


def test_passes_as_far_apart_as_they_are_change_what_is_said(monkeypatch):
    """2e-5 about the focus, against a pass in every step (docstring of the spacing)."""
    water = AcousticMedium(1000.0, 1482.0, 0.0, 2.0, 5.0)

    def axis():
        bowl, drive = FocusedBowl(32e-3, 10e-3, 62.6e-3), Drive(1.1e6, 50.0)
        z = np.linspace(55e-3, 70e-3, 31)
        return np.asarray(solve_field(bowl, drive, [AcousticLayer(water, 0.1)], r=np.zeros(1), z=z).pressure[0, 0])

    apart = axis()
    monkeypatch.setattr("arfjax.acoustics.sponge._SPACING", 1e-9)
    every = axis()
    assert 0.0 < np.abs(apart - every).max() < 2e-5 * np.abs(every).max()
