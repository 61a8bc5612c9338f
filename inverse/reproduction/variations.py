"""Constants of the lesion changed as in the paper: attenuation, modulus, exponent by a quarter, sound speed by 0.5 %.

Attenuation and sound speed change inside the lesion only. The sound field is that through the changed lesion (the beam
is attenuated and refracted by it), and the force has the local constants. What is reported is the change of the
displacement in points of that at 35 degC, where there is no lesion. The exponent n acts by 1.1^n at 1.1 MHz.

Accuracy: against twice the radial terms and half the step of the sound field, attenuation and exponent within 0.02
points, sound speed within 0.2.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax import Ellipsoid, LinearEdge, SharpEdge, suomi2016
from inverse.reproduction.bench import Bench, Case
from inverse.reproduction.row import Row
from inverse.reproduction.sound import variation_grid

SECTION = "variations"
_EDGE = 0.1e-3  # m; of the lesion whose attenuation is the same throughout: two cells of the variation's grid
_NO_EFFECT = 0.5
"""What "no effect was observed" allows, in points: half of the text's last digit."""


@dataclasses.dataclass(frozen=True)
class Variation:
    """What a change of the lesion does to the displacement at one temperature.

    Attributes:
        lesion: Where its size comes from.
        temperature: [degC].
        what: Constant that is changed, and how.
        change: As a share of the constant.
        points: Change of the displacement [percent points of that at 35 degC].
    """

    lesion: str
    temperature: float
    what: str
    change: float
    points: float


def lesion_variations(bench: Bench, lesion: str) -> list[Variation]:
    """Every variation of the paper at every temperature of table 3, and some that tell where its effect comes from.

    Args:
        bench: The experiment, with its linear field.
        lesion: "table", "semi-axes" or "dose"; the edge is linear and moduli are Young's.
    """
    start, case = bench.protocol.start_temperature, Case(lesion)
    fresh = float(jnp.vdot(bench.response(case, start), bench.linear(start).force))
    found = []
    for temperature in suomi2016.TABLE_3_LESION:
        response, force = bench.response(case, temperature), bench.linear(temperature).force
        as_it_is = float(jnp.vdot(response, force))

        def add(
            what: str, change: float, displacement: Array, temperature: float = temperature, base: float = as_it_is
        ) -> None:
            points = 100.0 * (float(displacement) - base) / fresh
            found.append(Variation(lesion, temperature, what, change, points))

        for name, change, varied in _varied_forces(bench, lesion, temperature, force):
            add(name, change, jnp.vdot(response, varied))
        for change in _both_ways("modulus"):
            add("modulus", change, jnp.vdot(bench.response(case, temperature, lesion_stiffness=1.0 + change), force))
        for change in _both_ways("attenuation"):
            scaled = _whole_liver(bench, temperature, change)
            add("attenuation of all liver", change, jnp.vdot(response, scaled))
    return found


def _varied_forces(
    bench: Bench, lesion: str, temperature: float, force: Float[Array, "rq zq"]
) -> list[tuple[str, float, Array]]:
    """Name, relative change and force density of each change of the lesion's acoustic constants."""
    uniform, linear = (_share(bench, lesion, temperature, sharp=sharp) for sharp in (True, False))
    liver = bench.model.liver.acoustic(temperature)
    attenuation, speed = float(liver.attenuation), float(liver.sound_speed)
    frequency_mhz = 1e-6 * float(bench.model.drive.frequency)
    unchanged, forces = np.zeros_like(uniform), []
    for change in _both_ways("attenuation"):
        varied = bench.varied_force(temperature, change * attenuation * uniform, unchanged)
        forces.append(("attenuation", change, varied))
        at_points = _share(bench, lesion, temperature, sharp=True, at_points=True)
        forces.append(("attenuation, force only", change, force * (1.0 + change * at_points)))
        forces.append(("attenuation, path only", change, varied / (1.0 + change * at_points)))
        falling = bench.varied_force(temperature, change * attenuation * linear, unchanged)
        forces.append(("attenuation, linear edge", change, falling))
    for change in _both_ways("sound speed"):
        forces.append(("sound speed", change, bench.varied_force(temperature, unchanged, change * speed * uniform)))
    for change in _both_ways("exponent"):
        factor = frequency_mhz ** (change * float(liver.absorption_exponent)) - 1.0
        forces.append(("exponent", change, bench.varied_force(temperature, factor * attenuation * uniform, unchanged)))
    return forces


def _both_ways(constant: str) -> tuple[float, float]:
    return -suomi2016.TEXT_LESION_VARIATION[constant], suomi2016.TEXT_LESION_VARIATION[constant]


def _share(
    bench: Bench, lesion: str, temperature: float, *, sharp: bool, at_points: bool = False
) -> Float[np.ndarray, "r z"]:
    """Share of the lesion on the variation's grid, or at the Gauss points of the mesh."""
    size = bench.size(lesion, temperature)
    ellipsoid = Ellipsoid.of_length_and_diameter(size.length, size.diameter, centre=size.centre)
    mesh = bench.settings.mesh
    r, z = (mesh.gauss_r, mesh.gauss_z) if at_points else variation_grid(bench.settings)
    edge = SharpEdge(_EDGE) if sharp else LinearEdge()
    return np.asarray(edge.share(ellipsoid, r[:, None], z[None, :]))


def _whole_liver(bench: Bench, temperature: float, change: float) -> Float[Array, "rq zq"]:
    """Force with all liver's attenuation changed at this temperature: that of the temperature with as much of it."""
    mesh, model, front = bench.settings.mesh, bench.model, bench.settings.liver[0]
    attenuation = float(model.liver.acoustic(temperature).attenuation_at(model.drive.frequency))
    # Along the axis to each point; rays from the bowl's rim have 16 percent more way, of which this knows nothing.
    path = np.exp(-2.0 * change * attenuation * np.maximum(mesh.gauss_z - front, 0.0))
    return bench.linear(temperature).force * (1.0 + change) * jnp.asarray(path)[None, :]


def largest(variations: list[Variation], what: str, temperature: float | None = None) -> Variation:
    """The change that moves the displacement most, at one temperature [degC] or at any."""
    chosen = [each for each in variations if each.what == what and temperature in (None, each.temperature)]
    return max(chosen, key=lambda each: abs(each.points))


def variation_rows(variations: list[Variation]) -> list[Row]:
    """The paper's statements against the largest effect, for one lesion."""
    lesion = variations[0].lesion
    stated = suomi2016.TEXT_ATTENUATION_VARIATION_POINTS
    rows = []
    for what in ("attenuation", "attenuation, linear edge"):
        most = largest(variations, what)
        force, path = (largest(variations, f"attenuation, {part} only", most.temperature) for part in ("force", "path"))
        why = (
            f"'less than 0.1 %'; largest at {most.temperature:g} degC ({100.0 * most.change:+.0f} percent: "
            f"{most.points:+.2f}): the local force alone {abs(force.points):.2f}, the path through the lesion alone "
            f"{abs(path.points):.2f}"
        )
        name = f"displacement, lesion's {what} +-25 percent, lesion by {lesion}"
        rows.append(Row(SECTION, name, stated, abs(most.points), "points", 0.05, why))
    hot = largest(variations, "modulus", 70.0)
    sizes = ", ".join(
        f"{abs(largest(variations, 'modulus', temperature).points):.2f} at {temperature:g} degC"
        for temperature in suomi2016.TABLE_3_LESION
    )
    name = f"displacement at 70 degC, lesion's modulus +-25 percent, lesion by {lesion}"
    why = f"larger of both ways; {sizes}"
    rows.append(Row(SECTION, name, suomi2016.TEXT_MODULUS_VARIATION_POINTS, abs(hot.points), "points", 0.5, why))
    for what, percent in (("sound speed", 0.5), ("exponent", 25.0)):
        most = largest(variations, what)
        name = f"displacement, lesion's {what} +-{percent:g} percent, lesion by {lesion}"
        why = f"'no effect was observed'; largest at {most.temperature:g} degC. Linear sound at 1.1 MHz"
        rows.append(Row(SECTION, name, 0.0, abs(most.points), "points", _NO_EFFECT, why))
    return rows
