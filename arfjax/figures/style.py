"""What all figures have in common."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from arfjax.laws import SMALLEST_DAMAGE
from arfjax.model import Model
from arfjax.thermal.dose import LETHAL_DOSE_MINUTES

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Colours that colour-blind readers can tell apart (Okabe and Ito)."""


def new_figure(width: float, height: float) -> Figure:
    """An empty figure [inches] in the style of all figures here."""
    return Figure(figsize=(width, height), layout="constrained", dpi=160)


def tidy(axes: Axes, *, x: str, y: str, title: str = "") -> None:
    """Label axes and take away what a reader does not need."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title, fontsize="medium", loc="left")
    axes.spines[["top", "right"]].set_visible(False)


def mirrored(dataset: xr.Dataset, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axial and radial positions [mm] and values of a map, with its mirror image below the axis."""
    radial, axial = (str(dimension) for dimension in dataset[name].dims)
    r, z = 1e3 * dataset[radial].to_numpy(), 1e3 * dataset[axial].to_numpy()
    values = dataset[name].to_numpy()
    first = 1 if r[0] == 0.0 else 0  # the axis itself has no mirror image
    return z, np.concatenate([-r[first:][::-1], r]), np.concatenate([values[first:][::-1], values])


def draw_layers(axes: Axes, model: Model, *, colour: str) -> None:
    """A dashed line at every interface of the path."""
    depth = 0.0
    for layer in model.path:
        depth += 1e3 * layer.thickness
        axes.axvline(depth, color=colour, linewidth=0.7, linestyle="--")


def draw_lesion(axes: Axes, dataset: xr.Dataset, *, colour: str) -> None:
    """The contour of the lethal dose."""
    z, both, dose = mirrored(dataset, "thermal_dose")
    level = np.log(np.maximum(dose, SMALLEST_DAMAGE) / LETHAL_DOSE_MINUTES)
    if level.max() > 0.0:
        axes.contour(z, both, level, [0.0], colors=colour, linewidths=1.3)


def centre_on_focus(axes: Axes, model: Model) -> None:
    """Show what is near the geometric focus, to scale."""
    focus = 1e3 * float(model.bowl.focal_length)
    axes.set_xlim(focus - 12.0, focus + 12.0)
    axes.set_ylim(-6.0, 6.0)
    axes.set_aspect("equal")
