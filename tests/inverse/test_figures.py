"""Figures of fits: what is in the way of what."""

from pathlib import Path

import numpy as np
import pytest

from inverse.datasets.thermometry import ThermometryData
from inverse.figures import heating_figure
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
