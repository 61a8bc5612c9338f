"""How finely the sound field is computed."""

import math

import equinox as eqx

from arfjax.acoustics.nonlinearity import FEWEST_HARMONICS
from arfjax.errors import InputError


class MarchSettings(eqx.Module):
    """Discretisation of the march. The defaults are for about 1 MHz in water and a bowl of up to 34 mm radius.

    Attributes:
        n_harmonics: Harmonics that are carried, the fundamental counted; 1 for linear sound, else 5 or more.
        n_radial: Terms of the Bessel series; pi n_radial / domain_radius must exceed the wavenumber.
        domain_radius: Where the series ends [m].
        axial_step: Longest step [m]; the default is a quarter of a wavelength at 1.1 MHz in water.
        start_plane: Where the march starts [m from the apex]: past the source's foremost point, inside the first layer.
            A source that is given on a plane starts on that plane instead.
        sponge_start: Where the absorbing ring begins, as a fraction of the domain; the field is clean inside.
        sponge_end: Where it reaches full strength.
        sponge_strength: Full strength [Np per domain radius of axial travel]. Chosen, like the two fractions, by the
            error against O'Neil's formula about the focus, which is flat around the default.
        n_quadrature: Gauss points of the source's integrals; see `radiated_pressure`.
        n_substeps: Into how many parts each step is cut for steepening alone; see `steepen` for what is stable.
        steepens_from_source: Whether sound steepens from the source's surface on, along its rays up to the start plane,
            or only from the start plane on.
        reflects: Whether interfaces keep back what normal incidence reflects; if not, all power passes.
        steps_per_checkpoint: See `march`: more save memory in the reverse mode.

    Raises:
        InputError: if there are 2 to 4 harmonics, a count is below 1, or a length makes no sense.
    """

    n_harmonics: int = eqx.field(static=True, default=1)
    n_radial: int = eqx.field(static=True, default=256)
    domain_radius: float = eqx.field(static=True, default=62e-3)
    axial_step: float = eqx.field(static=True, default=0.34e-3)
    start_plane: float = eqx.field(static=True, default=12e-3)
    sponge_start: float = eqx.field(static=True, default=0.55)
    sponge_end: float = eqx.field(static=True, default=0.97)
    sponge_strength: float = eqx.field(static=True, default=400.0)
    n_quadrature: int = eqx.field(static=True, default=320)
    n_substeps: int = eqx.field(static=True, default=1)
    steepens_from_source: bool = eqx.field(static=True, default=True)
    reflects: bool = eqx.field(static=True, default=True)
    steps_per_checkpoint: int = eqx.field(static=True, default=1)

    def __check_init__(self) -> None:
        """Refuse counts that cannot be meant."""
        if 1 < self.n_harmonics < FEWEST_HARMONICS:
            raise InputError(
                f"`n_harmonics` must be 1, for linear sound, or {FEWEST_HARMONICS} or more, got {self.n_harmonics}: "
                "the upper half of fewer harmonics cannot tell whether the waveform is resolved."
            )
        for name in ("n_harmonics", "n_radial", "n_quadrature", "n_substeps", "steps_per_checkpoint"):
            if getattr(self, name) < 1:
                raise InputError(f"`{name}` must be at least 1, got {getattr(self, name)}.")
        if not 0.0 < self.axial_step < self.domain_radius < 10.0:
            raise InputError(
                f"`axial_step` {self.axial_step} m must be above 0 and below `domain_radius` {self.domain_radius} m. "
                "Millimetres? Pass metres."
            )
        if not math.isfinite(self.start_plane):
            raise InputError(f"`start_plane` must be finite [m], got {self.start_plane}.")
        if not 0.0 < self.sponge_start < self.sponge_end <= 1.0 or not 0.0 <= self.sponge_strength < float("inf"):
            raise InputError(
                f"the absorbing ring needs 0 < sponge_start < sponge_end <= 1 and a strength from 0 on, got "
                f"{self.sponge_start}, {self.sponge_end} and {self.sponge_strength}."
            )
