"""Figures of fits: what is in the way of what."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from inverse.datasets.dma import dma_data, group_sweeps
from inverse.datasets.hmi import HmiData
from inverse.datasets.thermometry import ThermometryData
from inverse.figures import dma_panels, heating_figure
from inverse.figures.posterior import hmi_panels
from inverse.thermometry_fit import HeatingFit
from inverse.thermometry_model import GaussianHeating
from inverse.uncertainty import Uncertainty


def fit_of(temperature):
    """A fit that goes through all of a course of two minutes, on for all of it."""
    time = np.linspace(0.0, 120.0, len(temperature))
    data = ThermometryData(Path("x.csv"), time, temperature, None, None, None, np.zeros(len(time), dtype=bool))
    sure = Uncertainty(np.eye(5), np.ones(5), np.eye(5), 1.0, {}, ())
    return HeatingFit(
        data=data,
        baseline=37.0,
        heating=GaussianHeating(7.0, 20.0, 4.0, 0.0, 120.0),
        values=np.ones(5),
        uncertainty=sure,
        fitted=temperature,
        ratio_range=(None, None),
        ratio_doubt="",
        baseline_unseen=False,
        curve_time=time,
        curve=temperature,
        used=np.ones(len(time), dtype=bool),
        rms=0.1,
        noise_sd=0.1,
        autocorrelation=0.0,
        n_starts=1,
        n_agreeing=1,
        seed=0,
        converged=True,
        status="converged",
    )


@pytest.mark.parametrize("rising", [True, False])
def test_the_legend_of_a_course_covers_none_of_it(rising):
    """Also of one that rises to its end, where the corner of the legend of others is."""
    course = 37.0 + 7.0 * np.linspace(0.0, 1.0, 41) ** 0.5
    figure = heating_figure(fit_of(course if rising else course[::-1]))
    figure.canvas.draw()
    axis = figure.axes[0]
    legend = axis.get_legend()
    assert legend is not None
    (points,) = (line for line in axis.lines if line.get_label() == "measured mean")
    places = axis.transData.transform(points.get_xydata())
    assert not any(legend.get_window_extent().contains(x, y) for x, y in places)


def test_residuals_of_a_course_are_measured_minus_fitted_beside_twice_the_noise():
    fit = dataclasses.replace(fit_of(np.linspace(37.0, 44.0, 41)), noise_sd=0.3, used=np.arange(41) > 4)
    fit = dataclasses.replace(fit, fitted=fit.data.temperature - 0.1)
    _, lower = heating_figure(fit).axes
    (points,) = (line for line in lower.lines if line.get_marker() == "o")
    np.testing.assert_allclose(points.get_xydata(), np.stack([fit.data.time[5:], np.full(36, 0.1)], axis=1))
    levels = sorted(float(line.get_ydata()[0]) for line in lower.lines if line is not points)
    np.testing.assert_allclose(levels, [-0.6, 0.0, 0.6])


def test_panels_of_sweeps_find_their_data_among_all_moduli_and_phases():
    """Three rows at 20 degC and two at 50: moduli first, phases behind all of them, in the units of the axes."""
    moduli = 1e6 * np.array([[3.0, 4.0], [5.0, 2.0], [6.0, 1.0], [2.0, 2.0], [4.0, 3.0]])
    data = dma_data(np.array([1.0, 2.0, 4.0, 3.0, 6.0]), np.array([20.0] * 3 + [50.0] * 2), moduli)
    panels = dma_panels(group_sweeps(data))
    assert [panel.title for panel in panels] == [
        "Modulus, 20.0 °C", "Loss angle, 20.0 °C", "Modulus, 50.0 °C", "Loss angle, 50.0 °C",
    ]  # fmt: skip
    assert [panel.rows.tolist() for panel in panels] == [[0, 1, 2], [5, 6, 7], [3, 4], [8, 9]]
    np.testing.assert_array_equal(panels[2].x, [3.0, 6.0])
    assert panels[0].y_label == "$|M|$ [MPa]"
    np.testing.assert_allclose(panels[0].shown(np.log([5e6])), 5.0)
    np.testing.assert_allclose(panels[1].shown(np.array([0.25])), 250.0)


@pytest.mark.parametrize(("in_percent", "unit", "shown"), [(False, "µm", 1e6), (True, "%", 1.0)])
def test_panels_of_curves_hold_the_rows_of_their_sonication(in_percent, unit, shown):
    """Places are among the rows that a measurement holds, of which the file's second is none."""
    temperature, values = np.array([40.0, 37.0, 50.0, 60.0]), np.array([3.0, 4.0, 5.0, 6.0])
    data = HmiData(Path("x.csv"), ("a", "a", "b", "a"), temperature, None, values, in_percent, None, ())
    first, second = hmi_panels(data, np.array([0, 2, 3]))
    assert (first.rows.tolist(), second.rows.tolist()) == ([0, 2], [1])
    assert (first.x.tolist(), second.x.tolist(), second.title) == ([40.0, 60.0], [50.0], "Sonication b")
    assert first.y_label == f"Displacement [{unit}]"
    np.testing.assert_allclose(first.shown(np.array([2.0])), 2.0 * shown)
