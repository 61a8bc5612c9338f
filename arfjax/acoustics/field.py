"""What a solution of the sound field holds, and how far it can be trusted."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Complex, Float


class Convergence(eqx.Module):
    """Estimates of what the discretisation makes wrong, each relative to the largest amplitude on the axis.

    Attributes:
        harmonics: Part of the upper half of the harmonics in their sum on the axis. Without dissipation at shocks the
            ones left out would be smaller; with it, it is about what the upper half has lost.
        radial: Part of the last tenth of the Bessel series in the pressure on the axis.
        axial: A third of the difference, over the whole beam at the end of the march and each harmonic weighted with
            its order, that a march of twice the longest step makes: the error of a second-order method. It is computed
            only if asked for: under `jit` nothing is lost where it is not used.
        shock_fraction: Largest S of a cross-section over its largest A (`nonlinearity`); above some per cent the upper
            harmonics stand for a shock thinner than they resolve, whose heat is right but whose peak is not.
        courant_number: Largest `courant_number` of a substep; above 2.8 the steepening is unstable.
    """

    harmonics: Float[Array, ""]
    radial: Float[Array, ""]
    axial: Float[Array, ""]
    shock_fraction: Float[Array, ""]
    courant_number: Float[Array, ""]

    @property
    def error(self) -> Float[Array, ""]:
        """Sum of the three estimates [1]."""
        return self.harmonics + self.radial + self.axial

    def shortcoming(self, tolerance: float) -> str:
        """What is to be done to get within a relative tolerance, empty if nothing; for concrete values."""
        said = []
        if not float(self.courant_number) < STABLE_COURANT_NUMBER:
            said.append(f"steepening is unstable (Courant number {self.courant_number:.2g}): raise `n_substeps`")
        if not float(self.harmonics) <= tolerance:
            said.append(f"the harmonics end too early ({self.harmonics:.1e}): raise `n_harmonics`")
        if not float(self.radial) <= tolerance:
            said.append(f"the Bessel series ends too early ({self.radial:.1e}): raise `n_radial`")
        if not float(self.axial) <= tolerance:
            said.append(f"the steps are too long ({self.axial:.1e}): shorten `axial_step`")
        return "; ".join(said)


STABLE_COURANT_NUMBER = 2.8
"""Runge and Kutta's rule of fourth order on the imaginary axis."""


class HarmonicField(eqx.Module):
    """Complex peak amplitudes of a field's harmonics, and what of the media is needed to read them.

    The pressure in time is the real part of the sum of pressure[n] exp(2 pi i frequency[n] t). A position on an
    interface counts to the layer beyond it.

    Attributes:
        pressure: [Pa].
        r: Radii [m].
        z: Axial positions from the bowl's apex [m].
        frequency: Of each harmonic [Hz].
        density: Along z [kg/m^3].
        sound_speed: Local value [m/s].
        attenuation: Local value, of each harmonic's amplitude [Np/m].
        absorption_fraction: Share of attenuation that is absorption, along z [1].
        steepening_rate: beta omega / (rho c^3) along z [1/(Pa m)].
        layer_power: Acoustic power that enters and that leaves each layer up to the last position [W], all harmonics.
        convergence: How far the numbers can be trusted.
    """

    pressure: Complex[Array, "harmonic r z"]
    r: Float[Array, " r"] | Float[np.ndarray, " r"]
    z: Float[Array, " z"] | Float[np.ndarray, " z"]
    frequency: Float[Array, " harmonic"]
    density: Float[Array, " z"]
    sound_speed: Float[Array, "r z"]
    attenuation: Float[Array, "harmonic r z"]
    absorption_fraction: Float[Array, " z"]
    steepening_rate: Float[Array, " z"]
    layer_power: Float[Array, "layer 2"]
    convergence: Convergence
