"""Figures show the numbers that they are given, in the units of their axes."""

import numpy as np
import pytest
from matplotlib.contour import QuadContourSet

from arfjax.experiment import read_experiment
from arfjax.figures import (
    COLOURS,
    draw_displacement,
    draw_heating,
    draw_lesion_on_force,
    draw_monitoring,
    draw_push,
    draw_sonication,
    draw_sound,
    draw_temperature_maps,
    draw_vibration,
)
from arfjax.figures.style import mirrored
from arfjax.io import full_field_dataset, labelled, push_dataset
from arfjax.thermal.dose import LETHAL_DOSE_MINUTES
from tests.experiment_files import EXAMPLE
from tests.test_io import FOCUS, beam, watched

MODEL = read_experiment(EXAMPLE).model()
TIME = np.linspace(0.0, 60.0, 7)
HEATED_R, HEATED_Z = 0.25e-3 * (np.arange(20) + 0.5), FOCUS + 0.5e-3 * np.arange(-20.0, 21.0)
LESION = {"lesion_length_m": 8e-3, "lesion_diameter_m": 3e-3, "lesion_centre_m": FOCUS - 1e-3}


def panels(figure):
    """Axes by the beginning of their title."""
    return {axes.get_title(loc="left").split(";")[0]: axes for axes in figure.axes}


def curves(axes):
    return {line.get_label(): line.get_xydata() for line in axes.get_lines()}


def first_curve(axes):
    return axes.get_lines()[0].get_xydata()


def course(*names):
    """Curves over a sonication, no two of them alike."""
    return {name: (("heating_time",), (1.0 + number) * np.sqrt(TIME)) for number, name in enumerate(names)}


def heated(*, at_end):
    """A lethal dose within an ellipsoid 12 mm long and 4 mm wide about the focus, at two times or at the last."""
    dose = LETHAL_DOSE_MINUTES * np.exp(1.0 - (HEATED_R[:, None] / 2e-3) ** 2 - ((HEATED_Z - FOCUS) / 6e-3) ** 2)
    maps = {"temperature": 37.0 + 0.1 * dose, "thermal_dose": dose}
    of_map, axes = ("heat_r", "heat_z"), {"heat_r": HEATED_R, "heat_z": HEATED_Z, "heating_time": TIME[-2:]}
    variables = {name: (("heating_time", *of_map), np.stack([0.9 * each, each])) for name, each in maps.items()}
    if at_end:
        variables = {name: (of_map, each) for name, each in maps.items()}
    variables["focal_temperature"] = ("heating_time",), np.array([50.0, 61.0])
    return labelled(variables, axes)


@pytest.mark.parametrize(("r", "both"), [([0.0, 1.0, 2.0], [-2, -1, 0, 1, 2]), ([0.5, 1.5], [-1.5, -0.5, 0.5, 1.5])])
def test_the_mirror_image_of_a_map_doubles_no_axis(r, both):
    r, z = 1e-3 * np.asarray(r), np.asarray([0.06, 0.07])
    data = labelled({"intensity": (("r", "z"), 1e3 * r[:, None] + z)}, {"r": r, "z": z})
    axial, radial, values = mirrored(data, "intensity")
    np.testing.assert_allclose(radial, both)
    np.testing.assert_allclose(axial, [60.0, 70.0])
    np.testing.assert_allclose(values, np.abs(np.asarray(both, float))[:, None] + z)


def test_power_falls_by_what_is_lost_in_a_layer():
    """The second layer, 2 mm of skin, leaves no room for its number."""
    data = full_field_dataset(beam(3), FOCUS, tolerance=1e-3).assign_coords(z=np.linspace(5e-3, 80e-3, 71))
    axes = panels(draw_sound(data, MODEL))["power in the beam"]
    np.testing.assert_allclose(first_curve(axes), [[5.0, 50.0], [20.6, 48.0], [20.6, 47.0], [22.6, 30.0]])
    assert [text.get_text() for text in axes.texts] == ["2 W"]


def outlines(axes):
    """Points on each contour line [mm]."""
    contours = [each for each in axes.collections if isinstance(each, QuadContourSet) and not each.filled]
    return [np.concatenate([path.vertices for path in each.get_paths()]) for each in contours]


def test_the_lethal_dose_is_outlined_on_both_sides_of_the_axis():
    """To what a straight line between two cells of 0.25 mm makes of a parabola."""
    force = labelled(
        {"radiation_force_density": (("r", "z"), 1.0 - (HEATED_R[:, None] / 6e-3) ** 2 + 0.0 * HEATED_Z)},
        {"r": HEATED_R, "z": HEATED_Z},
    )
    warmed = heated(at_end=False)
    figures = (
        draw_heating(heated(at_end=True), MODEL),
        draw_temperature_maps(warmed, MODEL, [TIME[-1]]),
        draw_lesion_on_force(force, warmed.isel(heating_time=-1), MODEL),
    )
    for figure in figures:
        z, r = outlines(figure.axes[1] if figure is figures[0] else figure.axes[0])[-1].T
        np.testing.assert_allclose((r / 2.0) ** 2 + ((z - 1e3 * FOCUS) / 6.0) ** 2, 1.0, atol=(0.25 / 2.0) ** 2 / 4.0)
        assert r.min() == pytest.approx(-r.max()) and z.min() + z.max() == pytest.approx(2e3 * FOCUS)
    half = np.abs(outlines(figures[2].axes[0])[0][:, 1])
    np.testing.assert_allclose(half, 6.0 * np.sqrt(1.0 - 0.5 * (1.0 - (0.125 / 6.0) ** 2)), rtol=1e-3)
    np.testing.assert_allclose(first_curve(figures[0].axes[0]), [[50.0, 50.0], [60.0, 61.0]])


def test_a_sonication_s_curves_and_its_lesion():
    at_focus = ("peak_temperature", "focal_temperature", "thermocouple_temperature", "focal_dose")
    names = (*at_focus, "lesion_length", "lesion_diameter", "lesion_volume", "field_updates")
    data = labelled(course(*names), {"heating_time": TIME})
    temperature, dose, lesion = draw_sonication(data).axes
    for axes, shown in (
        (temperature, {"anywhere": (0, 1.0), "at the focus": (1, 1.0), "thermocouple": (2, 1.0)}),
        # 1 m^3 is 1e9 mm^3, and the axis counts tens of them.
        (lesion, {"length [mm]": (4, 1e3), "diameter [mm]": (5, 1e3), "volume [10 mm³]": (6, 1e8)}),
    ):
        for label, (number, scale) in shown.items():
            expected = np.stack([TIME, scale * data[names[number]]], axis=1)
            np.testing.assert_allclose(curves(axes)[label], expected)
    np.testing.assert_allclose(first_curve(dose), np.stack([TIME, data["focal_dose"]], axis=1)[1:])


def test_displacement_by_temperature_and_its_pushes():
    steps, times = np.array([37.0, 50.0, 60.0]), np.array([0.0, 2e-4, 5e-4])
    by_step = ("step_temperature",)
    data = labelled(
        {
            "displacement_percent": (by_step, np.array([100.0, 120.0, 80.0])),
            "lesion_length": (by_step, np.array([0.0, 1e-3, 9e-3])),
            "lesion_diameter": (by_step, np.array([0.0, 5e-4, 2e-3])),
            "focal_displacement": ((*by_step, "push_time"), np.outer([1.0, 1.2, 0.8], [0.0, 2e-6, 9e-6])),
        },
        {"step_temperature": steps, "push_time": times},
    ).assign_attrs(reference_temperature_degc=37.0)
    percent, lesion, pushes = draw_displacement(data).axes
    np.testing.assert_allclose(first_curve(percent), [[37.0, 100.0], [50.0, 120.0], [60.0, 80.0]])
    np.testing.assert_allclose(curves(lesion)["length"], [[37.0, 0.0], [50.0, 1.0], [60.0, 9.0]])
    np.testing.assert_allclose(curves(lesion)["diameter"], [[37.0, 0.0], [50.0, 0.5], [60.0, 2.0]])
    np.testing.assert_allclose(curves(pushes)["50 °C"], [[0.0, 0.0], [0.2, 2.4], [0.5, 10.8]])


def outline_of(points, along):
    """Extent of a lesion's outline across and along the axis [mm]."""
    lowest, highest = points.min(axis=0), points.max(axis=0)
    return np.stack([lowest, highest], axis=1)[[1 - along, along]]


def test_a_push_with_its_lesion_and_its_wave():
    data = push_dataset(watched(), 40.0).assign_attrs(LESION)
    figure = draw_push(data, MODEL, push_duration=5e-4)
    for frame in figure.axes[:4]:
        assert frame.get_title(loc="left").startswith("t = ")
        np.testing.assert_allclose(outline_of(first_curve(frame), 1), [[-1.5, 1.5], [-5.0, 3.0]], rtol=1e-3)
    shown = panels(figure)
    at_focus = np.stack([1e3 * data["course_time"], 1e6 * data["focal_displacement"]], axis=1)
    np.testing.assert_allclose(first_curve(shown["at the geometric focus"]), at_focus)
    arrival = np.stack([1e3 * data["shear_wave_arrival"], 1e3 * data["r"]], axis=1)
    np.testing.assert_allclose(first_curve(shown["in the focal plane"]), arrival)


def test_a_vibration_with_its_lesion_and_its_force():
    time, r, z = np.linspace(0.0, 0.02, 9), np.linspace(0.0, 0.01, 5), FOCUS + np.linspace(-0.02, 0.02, 5)
    data = labelled(
        {
            "peak_to_peak_displacement": (("r", "z"), 1e-6 * np.ones((5, 5))),
            "focal_vibration": (("modulation_time",), 3e-6 * np.cos(100.0 * np.pi * time)),
            "relative_force": (("modulation_time",), 0.5 + 0.5 * np.cos(100.0 * np.pi * time)),
        },
        {"r": r, "z": z, "modulation_time": time},
    ).assign_attrs(LESION | {"modulation_frequency_hz": 50.0})
    shown = panels(draw_vibration(data, MODEL))
    extent = outline_of(first_curve(shown["50 Hz"]), 0)
    np.testing.assert_allclose(extent, [[-1.5, 1.5], [57.6, 65.6]], rtol=1e-3)
    motion = first_curve(shown["one period at the geometric focus"])
    np.testing.assert_allclose(motion, np.stack([1e3 * time, 1e6 * data["focal_vibration"]], axis=1))


def test_monitoring_heats_and_cools_and_marks_where_the_lesion_appears():
    temperature, percent = np.array([37.0, 45, 55, 65, 60, 50, 45]), np.array([100.0, 110, 120, 80, 70, 75, 78])
    length = 1e-3 * np.array([0.0, 0, 1, 4, 5, 5, 5])
    by_time = ("heating_time",)
    data = labelled(
        {
            "tracked_displacement_percent": (by_time, percent),
            "thermocouple_temperature": (by_time, temperature),
            "lesion_length": (by_time, length),
            "lesion_diameter": (by_time, 0.3 * length),
        },
        {"heating_time": TIME},
    ).assign_attrs(reference_temperature_degc=37.0)
    figure = draw_monitoring(data)
    shown, both = panels(figure), np.stack([temperature, percent], axis=1)
    np.testing.assert_allclose(first_curve(shown["as it is watched"]), np.stack([TIME, percent], axis=1))
    np.testing.assert_allclose(curves(shown["over temperature"])["heating"], both[:4])
    np.testing.assert_allclose(curves(shown["over temperature"])["cooling"], both[4:])
    np.testing.assert_allclose(curves(shown["over temperature"])["lesion appears"], both[2:3])
    for label, scale in (("length", 1e3), ("diameter", 300.0)):
        np.testing.assert_allclose(curves(shown["lesion by dose"])[label], np.stack([TIME, scale * length], axis=1))
    (beside,) = (axes for axes in figure.axes if axes.get_ylabel().startswith("thermocouple"))
    assert beside.get_lines()[0].get_color() == COLOURS[3]
    np.testing.assert_allclose(first_curve(beside), np.stack([TIME, temperature], axis=1))
