"""The full simulation of curves of displacement on a mesh and time steps of its own, for the blind generator."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

import arfjax as ax
from arfjax.laws import PolynomialThrough
from arfjax.protocols.heated_tissue import force_on
from arfjax.protocols.probing import ShortPush, on_axis_at
from arfjax.protocols.sonication import sonication_field
from arfjax.protocols.stepwise import force_at, lesion_at, lesion_share, push, simulate_heating
from arfjax.protocols.transient import TissueState, solid_of
from tests.blind.hmi_effects import DURATION, REACH, SENSORS, TISSUE, TRACKING, Scene

ANCHORS = (35.0, 45.0, 55.0, 65.0, 84.0)
FINAL = (63.0, 73.0, 83.0)
REFERENCE = 37.0
MESH, HEAT, HEAT_STEPS = 1.5, 2.4, 310
"""Refinements of the solid and of heat, and steps of a sonication. The diagnosis has 1, 2 and 240, its fast simulation
heat at 1.5 in 90."""
OFTEN = 3001
"""Times at which a thermocouple is followed."""


def readings(final: float) -> np.ndarray:
    """Temperatures that are read in a sonication to a final one."""
    return np.arange(REFERENCE, final + 0.1, 2.0)


def groups() -> np.ndarray:
    """Which sonication every reading is of."""
    return np.repeat(np.arange(len(FINAL)), [len(readings(final)) for final in FINAL])


class Simulator:
    """The full simulation of the design's sonications on one mesh; compiled once for all constants.

    With an `order`, solids are fractional with it and every point of the tissue has its own temperature, which sets
    sound along the path, moduli, and the shape of the lesion. Without, liver is uniformly as warm as its focus.
    """

    def __init__(self, described: ax.Experiment, order: float | None = None) -> None:
        base = described.model()
        self.by_point = order is not None
        law = base.liver.attenuation
        values = np.asarray(law.evaluate(np.asarray(ANCHORS)))
        through = PolynomialThrough(ANCHORS, jnp.asarray(values), unit=law.unit, source=law.source)
        base = eqx.tree_at(lambda m: m.liver.attenuation, base, through)
        if order is not None:
            solids = (base.liver.viscoelasticity, base.lesion.viscoelasticity)
            fractional = tuple(_fractional(solid, order) for solid in solids)
            base = eqx.tree_at(lambda m: (m.liver.viscoelasticity, m.lesion.viscoelasticity), base, fractional)
        # As arrays, so that other numbers need no new compilation.
        self.base = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), base)
        self.protocol = described.stepwise()
        mesh, heat = (ax.discretise(base, refinement=refinement) for refinement in (MESH, HEAT))
        self.settings = dataclasses.replace(
            mesh, heat_grid=heat.heat_grid, layer_of_cell=heat.layer_of_cell, n_heat_steps=HEAT_STEPS
        )
        protocol = dataclasses.replace(self.protocol, duration=DURATION)
        self._heated = eqx.filter_jit(lambda model: simulate_heating(model, protocol, self.settings))
        self._push = eqx.filter_jit(self._displacement)
        self._known: dict[tuple, tuple[np.ndarray, np.ndarray]] = {}
        self._imitated: dict[bytes, np.ndarray] = {}

    def model(self, z: np.ndarray) -> ax.Model:
        """Constants: nine standard normal numbers over what is believed."""
        lesion, liver = self.base.lesion.viscoelasticity, self.base.liver.viscoelasticity
        factors = np.exp(z * np.array([0.35] * 5 + [0.25, 0.5, 0.5, 0.5]))
        return eqx.tree_at(
            lambda m: (
                m.liver.attenuation.values,
                m.liver.viscoelasticity.branch_modulus.value,
                m.lesion.viscoelasticity.branch_modulus.value,
                m.lesion.viscoelasticity.branch_modulus.rate,
                m.lesion.viscoelasticity.relaxation_time.value,
            ),
            self.base,
            (
                self.base.liver.attenuation.values * factors[:5],
                liver.branch_modulus.value * factors[5],
                lesion.branch_modulus.value * factors[6],
                lesion.branch_modulus.rate * factors[7],
                lesion.relaxation_time.value * factors[8],
            ),
        )

    def curves(self, z: np.ndarray, name: str = "none", strength: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Logarithm of what is reported and times, of all readings of all sonications; the first of each at 37 degC."""
        if (key := (z.tobytes(), name, strength)) not in self._known:
            self._known[key] = self._curves(z, name, strength)
        return self._known[key]

    def imitated(self, z: np.ndarray, step: float = 0.02) -> np.ndarray:
        """Changes of the logarithm that constants and a factor of each sonication can make, one column each."""
        if z.tobytes() not in self._imitated:
            plain = self.curves(z)[0]
            columns = [(self._curves(z + step * unit, "none", 0.0)[0] - plain) / step for unit in np.eye(len(z))]
            factors = (groups()[:, None] == np.arange(len(FINAL))).astype(float)
            self._imitated[z.tobytes()] = np.column_stack([*columns, factors])
        return self._imitated[z.tobytes()]

    def _curves(self, z: np.ndarray, name: str, strength: float) -> tuple[np.ndarray, np.ndarray]:
        logarithms, times = [], []
        for final in FINAL:
            scene, heating = self._scene(z, final, name, strength)
            if name in TISSUE:
                TISSUE[name](scene, strength)
                _, heating = self._scene(z, final, name, strength, model=scene.model)
            reported = np.array([self._reading(scene, heating, i) for i in range(len(scene.shown))])
            reported = reported / reported[0]
            if name in TRACKING:
                reported = TRACKING[name](reported, scene, strength)
            logarithms.append(np.log(reported))
            times.append(scene.time)
        return np.concatenate(logarithms), np.concatenate(times)

    def _scene(self, z, final, name, strength, model=None):
        model = self.model(z) if model is None else model
        start, shown = self.protocol.start_temperature, readings(final)
        heated = self._heated(model)

        def course(highest: float):
            heating = _scaled_to(heated, highest, start)
            grid, focal = self.settings.heat_grid, np.asarray(heating.focal_temperature)
            near = np.asarray(grid.r) < REACH
            # The focus lies on a face: the mean of the cells before and behind it.
            behind = int(np.searchsorted(np.asarray(grid.z), self.settings.focus))
            temperature = np.asarray(heating.temperature)[:, near, behind - 1 : behind + 1].mean(axis=2)
            # Steps are too long for the first seconds, in which the temperature rises by 15 degrees.
            clock = np.asarray(heating.time)
            often = np.linspace(0.0, clock[-1], OFTEN)
            at_focus, across = (CubicSpline(clock, each)(often) for each in (focal, temperature))
            return heating, (often, at_focus, np.asarray(grid.r)[near], across)

        heating, at = course(final)
        showing = at[1]
        if name in SENSORS and strength:
            # The sonication went on until the thermocouple showed its last reading.
            highest = final
            for _ in range(6):
                showing = SENSORS[name](at, strength)
                highest = start + (highest - start) * (final - start) / (showing[-1] - start)
                heating, at = course(highest)
            showing = SENSORS[name](at, strength)
        time = np.interp(shown, showing, at[0])
        rate = np.gradient(at[1], at[0])
        dose = np.asarray(heating.dose)[
            :, 0, int(np.argmin(np.abs(np.asarray(self.settings.heat_grid.z) - self.settings.focus)))
        ]
        clock, minutes = np.asarray(heating.time), np.log(np.maximum(dose, 1e-30))
        coagulated = np.interp(np.log(240.0), minutes, clock, right=np.inf)
        factors, added = (np.full((count, len(shown)), value) for count, value in ((5, 1.0), (2, 0.0)))
        scene = Scene(
            model, shown, time, np.interp(time, at[0], at[1]), np.interp(time, at[0], rate),
            np.exp(np.interp(time, clock, minutes)), float(coagulated), *factors, *added,
        )  # fmt: skip
        return scene, heating

    def _reading(self, scene: Scene, heating, i: int) -> float:
        names = ("attenuation", "liver", "lesion", "threshold", "faster", "rim")
        factors = [jnp.asarray(getattr(scene, name)[i]) for name in names]
        moved = self._push(scene.model, jnp.asarray(scene.temperature[i]), heating, *factors)
        return float(scene.force[i] * moved)

    def _displacement(self, model, temperature, heating, attenuation, liver, lesion, threshold, faster, rim):
        def scaled(law, factor):
            return ax.Scaled(law=law, factor=factor, unit=law.unit, source=law.source, valid_range=law.valid_range)

        def stiffer(law, factor):
            both = (scaled(law.relaxed_modulus, factor), scaled(law.branch_modulus, factor))
            return eqx.tree_at(lambda each: (each.relaxed_modulus, each.branch_modulus), law, both)

        speed = model.liver.sound_speed
        model = eqx.tree_at(
            lambda m: (
                m.liver.attenuation,
                m.liver.sound_speed,
                m.liver.viscoelasticity,
                m.lesion.viscoelasticity,
                m.lesion.size.threshold,
            ),
            model,
            (
                scaled(model.liver.attenuation, attenuation),
                ax.Shifted(
                    law=speed, shift=faster, unit=speed.unit, source=speed.source, valid_range=speed.valid_range
                ),
                stiffer(model.liver.viscoelasticity, liver),
                stiffer(model.lesion.viscoelasticity, lesion),
                model.lesion.size.threshold * threshold,
            ),
        )
        if self.by_point:
            return self._displacement_by_point(model, temperature, heating)
        size = lesion_at(model, heating, temperature, self.settings)
        share = lesion_share(model, heating, temperature, size, self.settings, self.settings.mesh)
        share = share - rim * share * (1.0 - share)
        force = force_at(model, temperature, self.protocol, self.settings)
        return push(model, temperature, share, force, self.protocol, self.settings).at_focus(self.settings.focus)[-1]

    def _displacement_by_point(self, model, temperature, heating):
        """As the coupled protocol has it: nothing is uniform but the start."""
        start, settings = self.protocol.start_temperature, self.settings

        def now(values):
            after = jnp.clip(jnp.argmax(heating.focal_temperature >= temperature), 1, len(heating.time) - 1)
            low, high = heating.focal_temperature[after - 1], heating.focal_temperature[after]
            weight = (temperature - low) / (high - low)
            return values[after - 1] + weight * (values[after] - values[after - 1])

        here, dose = now(heating.temperature), now(heating.dose)
        state = TissueState(temperature=here, hottest=here, focal=temperature, dose=dose)
        sonication = ax.Sonication(phases=(), start_temperature=start)
        force = force_on(
            settings.mesh, settings, lambda r, z: sonication_field(model, sonication, settings, here, dose, r=r, z=z)
        )
        solid = solid_of(model, settings, state, settings.mesh)
        probe = ShortPush(self.protocol.push_duration, self.protocol.modulation)
        moved = probe.displacement(model, solid, start, force, settings)
        return on_axis_at(moved, settings.mesh, settings.focus)


def _fractional(law: ax.ZenerLaw, order: float) -> ax.FractionalZenerLaw:
    return ax.FractionalZenerLaw(
        relaxed_modulus=law.relaxed_modulus,
        branch_modulus=law.branch_modulus,
        relaxation_time=law.relaxation_time,
        fractional_order=ax.Constant(order, unit="1", source="drawn for a test"),
    )


def _scaled_to(heating: ax.Heating, highest: float, start: float) -> ax.Heating:
    """The sonication with another power: temperatures rise in proportion, and dose is counted again."""
    factor = (highest - start) / (float(heating.focal_temperature[-1]) - start)
    temperature = start + factor * (np.asarray(heating.temperature) - start)
    # Equivalent minutes at 43 degC (Sapareto & Dewey 1984), by the trapezoidal rule.
    minutes = np.where(temperature >= 43.0, 0.5, 0.25) ** (43.0 - temperature)
    dose = cumulative_trapezoid(minutes, np.asarray(heating.time), axis=0, initial=0.0) / 60.0
    focal = start + factor * (np.asarray(heating.focal_temperature) - start)
    return ax.Heating(
        time=heating.time, focal_temperature=jnp.asarray(focal), temperature=jnp.asarray(temperature),
        dose=jnp.asarray(dose), acoustic_power=factor * heating.acoustic_power,
    )  # fmt: skip
