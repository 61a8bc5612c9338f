"""What may be hidden in curves of displacement, written out as a person who knows the physics would."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import numpy as np
from scipy.interpolate import CubicSpline

import arfjax as ax
from tests.blind.no_such_effect import NoSuchEffect

DURATION = 60.0
"""Of every sonication [s]."""


@dataclasses.dataclass
class Scene:
    """One sonication as it was, arrays by reading.

    `model` may be changed throughout; the factors apply in the state of each reading, and so do what is added to the
    liver's sound speed and what the lesion's edge lacks.
    """

    model: ax.Model
    shown: np.ndarray
    time: np.ndarray
    temperature: np.ndarray
    rate: np.ndarray
    dose: np.ndarray
    coagulated_at: float
    attenuation: np.ndarray
    liver: np.ndarray
    lesion: np.ndarray
    threshold: np.ndarray
    force: np.ndarray
    faster: np.ndarray
    rim: np.ndarray

    @property
    def passed(self) -> np.ndarray:
        return self.time / DURATION

    @property
    def rise(self) -> np.ndarray:
        """Above the body's temperature."""
        return self.temperature - 37.0


Course = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Time, temperature of the focus, and radii and temperature beside it (time by radius)."""

REACH = 2e-3
"""Radius up to which the profile across the beam is known [m]."""


def _lag(course: Course, s: float) -> np.ndarray:
    """What a sensor of time constant s shows: the solution of s dT/dt = focus - T, step by step."""
    time, focus = course[0], course[1]
    shown = focus.copy()
    for i in range(1, len(time)):
        step = time[i] - time[i - 1]
        decay = np.exp(-step / s)
        slope = (focus[i] - focus[i - 1]) / step
        shown[i] = focus[i] - slope * s + (shown[i - 1] - focus[i - 1] + slope * s) * decay
    return shown


def beside(course: Course, s: float) -> np.ndarray:
    """At a distance whose square is s mm^2, between the cells of the grid.

    The rise is a cubic spline through all cells as far out as `REACH` and their mirror images beyond the axis.

    Raises:
        NoSuchEffect: if the distance is larger.
    """
    _, focus, r, temperature = course
    if s * 1e-6 > REACH**2:
        raise NoSuchEffect(f"{s:g} mm^2 lie beyond what the profile is known of.")
    profile = CubicSpline(np.r_[-r[::-1], r], np.c_[temperature[:, ::-1], temperature] - focus[0], axis=1)
    axis, here = profile(0.0), profile(np.sqrt(s * 1e-6))
    warm = focus > focus[0]
    share = np.ones(len(focus))
    share[warm] = here[warm] / axis[warm]
    share[~warm] = share[warm][0]
    return focus[0] + (focus - focus[0]) * share


SENSORS: dict[str, Callable[[Course, float], np.ndarray]] = {
    "thermocouple-lag": _lag,
    "thermocouple-position": beside,
    "thermocouple-viscous-heating": lambda c, s: c[1] + s * (1.0 - np.exp(-c[0] / 3.0)),
}
"""What the thermocouple shows over the sonication."""


def _model(place, change):
    def applied(scene: Scene, s: float) -> None:
        scene.model = eqx.tree_at(place, scene.model, change(place(scene.model), s))

    return applied


def _perfused(law, s):
    return ax.Constant(law(37.0) + s * 15.2 / 1050.0, unit=law.unit, source=law.source)


def _conducting(law, s):
    return ax.Constant(law(37.0) * (1.0 + s), unit=law.unit, source=law.source)


def _times(name: str, factor: Callable[[Scene, float], np.ndarray]):
    def applied(scene: Scene, s: float) -> None:
        setattr(scene, name, getattr(scene, name) * factor(scene, s))

    return applied


def _added(name: str, amount: Callable[[Scene, float], np.ndarray]):
    def applied(scene: Scene, s: float) -> None:
        setattr(scene, name, getattr(scene, name) + amount(scene, s))

    return applied


def _divided_elsewhere(scene: Scene, s: float) -> None:
    """The reading that all others are divided by was taken s kelvin warmer than it says."""
    scene.temperature = np.append(scene.temperature[0] + s, scene.temperature[1:])


def _refracted(c: Scene, s: float) -> np.ndarray:
    """Sound is fastest at 68 degC: force falls with the square of what it has gained by then."""
    to_go = (68.0 - c.temperature) / 33.0
    return 1.0 - s * (1.0 - to_go**2) ** 2


def _saturated(c: Scene, s: float) -> np.ndarray:
    """Where 20 mm of liver let more through than in the beginning, a part s of what more would come is lost."""
    at = [np.asarray(c.model.liver.attenuation.evaluate(np.asarray(t))) for t in (c.temperature, 35.0)]
    more = at[0] - at[1]
    return np.exp(s * 2.0 * 0.02 * more * c.model.drive.frequency / 1e6)


def _echoed(c: Scene, s: float) -> np.ndarray:
    """The wave that a boundary sends back comes with the lesion's shear speed, once there is one."""
    modulus = c.model.lesion.viscoelasticity.branch_modulus
    now, before = (np.asarray(modulus.evaluate(np.asarray(t))) for t in (c.temperature, 35.0))
    grown = 1.0 / (1.0 + (240.0 / np.maximum(c.dose, 1e-3)) ** 4)
    return 1.0 - s * grown * (np.sqrt(now / before) - 1.0)


def _gives_way(part: str):
    """A power law of order one half, to its first term, at the end of a push of half a millisecond."""

    def factor(c: Scene, s: float) -> np.ndarray:
        law = getattr(c.model, part).viscoelasticity.relaxation_time
        tau = np.asarray(law.evaluate(np.asarray(c.temperature))) * np.ones(len(c.time))
        return 1.0 / (1.0 + s * np.sqrt(4.0 * 0.5e-3 / (np.pi * tau)))

    return factor


def _fractional(scene: Scene, s: float) -> None:
    scene.liver = scene.liver * _gives_way("liver")(scene, s)
    scene.lesion = scene.lesion * _gives_way("lesion")(scene, s)


TISSUE: dict[str, Callable[[Scene, float], None]] = {
    "perfusion": _model(lambda m: m.liver.perfusion_rate, _perfused),
    "conductivity-change": _model(lambda m: m.liver.conductivity, _conducting),
    "damage-law": _times("threshold", lambda c, s: np.full(len(c.time), np.exp(s))),
    "output-drift": _times("force", lambda c, s: 1.0 + s * c.passed),
    "cavitation": _times("force", lambda c, s: 1.0 + s / (1.0 + np.exp(-(c.temperature - 67.8) / 2.0))),
    "lesion-stiffness-law": _times("lesion", lambda c, s: np.exp(s * 0.5 * ((c.temperature - 70.0) / 10.0) ** 2)),
    "pre-ablation-softening": _times(
        "liver", lambda c, s: 1.0 - s * np.exp(-0.5 * ((c.temperature - 48.25) / 4.0) ** 2)
    ),
    "attenuation-kinetics": _times(
        "attenuation", lambda c, s: 1.0 + s * (1.0 - np.exp(-np.maximum(c.time - c.coagulated_at, 0.0) / 118.0))
    ),
    "normalisation-temperature": _divided_elsewhere,
    "thermal-lens": _times("force", _refracted),
    "exponent-change": _times("attenuation", lambda c, s: (c.model.drive.frequency / 1e6) ** (s * c.rise / 43.0)),
    "sound-speed-change": _added("faster", lambda c, s: s * c.rise / 43.0),
    "lesion-rim": _added("rim", lambda c, s: np.full(len(c.time), s)),
    "fractional-tissue": _fractional,
    "acoustic-saturation": _times("force", _saturated),
    "near-boundary": _times("force", _echoed),
    # 30 mm at 8 Np/m, one percent more a kelvin, there and in power.
    "path-heating": _times("force", lambda c, s: np.exp(-2.0 * 0.03 * 8.0 * 0.01 * s * c.passed)),
}
"""What departs from the laws of the tissue or of the sound."""

TRACKING: dict[str, Callable[[np.ndarray, Scene, float], np.ndarray]] = {
    "thermal-decorrelation": lambda u, c, s: u * (1.0 - s * c.rate / 5.0),
    "echo-strain": lambda u, c, s: u + s * c.rate / 5.0,
    "tracking-compression": lambda u, c, s: u - s * u**2,
    "tracking-jitter": lambda u, c, s: np.hypot(u, np.sqrt(s)),
}
"""What tracking makes of displacement relative to the first reading's."""

UNSEEN = (
    "thermal-lens",
    "exponent-change",
    "sound-speed-change",
    "fractional-tissue",
    "lesion-rim",
    "acoustic-saturation",
    "path-heating",
)
"""What this design does not show, for one of two tissues at least, at strengths that there can be: the fitted constants
imitate it. No rates are measured of these."""
BOTH_WAYS = (
    "damage-law",
    "output-drift",
    "cavitation",
    "lesion-stiffness-law",
    "pre-ablation-softening",
    "attenuation-kinetics",
    "normalisation-temperature",
    "near-boundary",
    "echo-strain",
)
"""Effects of either sign: which one is drawn, unless the strength is given. (Less blood flow than none is not, and at
a tenth of the conductivity d' is 4.5.)"""

EFFECTS = tuple(name for name in (*SENSORS, *TISSUE, *TRACKING) if name not in UNSEEN)


def _bump(m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.exp(-0.5 * ((m - rng.uniform(45.0, 60.0)) / 1.5) ** 2)


def _smooth(m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    knots = np.linspace(36.0, 84.0, 13)
    distance = (knots[:, None] - knots[None, :]) / 5.0
    root = np.linalg.cholesky(np.exp(-0.5 * distance**2) + 1e-9 * np.eye(13))
    return np.interp(m, knots, root @ rng.standard_normal(13))


UNKNOWN = {"bump": _bump, "smooth": _smooth}
"""Changes of the logarithm of displacement that are in no list, as functions of temperature."""
