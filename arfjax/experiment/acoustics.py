"""The section of an experiment file that says how its sound field is computed."""

import dataclasses
from collections.abc import Callable
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import AfterValidator, Strict, model_validator

from arfjax.acoustics.converge import solve_to_tolerance
from arfjax.acoustics.diffraction import Diffraction, ExactOneWay, Pade11, Pade12, Parabolic
from arfjax.acoustics.field import HarmonicField
from arfjax.acoustics.nonlinearity import FEWEST_HARMONICS
from arfjax.experiment.numbers import Number, Section, between
from arfjax.model import Model
from arfjax.protocols.discretisation import Discretisation, discretise, layers_at

_FIRST_HARMONICS = 16
_MOST_HARMONICS = 1024


def _countable(value: int) -> int:
    if not FEWEST_HARMONICS <= value <= _MOST_HARMONICS:
        raise ValueError(
            f"expected {FEWEST_HARMONICS} to {_MOST_HARMONICS} harmonics, got {value}; leave it out and they are "
            "chosen by `tolerance`, or set nonlinear = false for the fundamental alone"
        )
    return value


class AcousticsSection(Section):
    """How sound is computed; all of it may be left out.

    Attributes:
        nonlinear: Whether sound steepens; where it is not said, each command has its own default.
        harmonics: How many are carried; chosen by `tolerance` where it is not said.
        diffraction: One-way operator.
        tolerance: Largest error of pressure over the largest on the axis [1].
        steepening: Along which path sound steepens; other operators than the exact one know only the axis.
        source: The bowl's true radiation, or its converging wave on the plane of its rim.
    """

    nonlinear: Annotated[bool, Strict()] | None = None
    harmonics: Annotated[int, Strict(), AfterValidator(_countable)] | None = None
    diffraction: Literal["exact", "pade12", "pade11", "parabolic"] = "exact"
    tolerance: Annotated[Number, between(1e-4, 0.1, "", "it is relative: 0.001 is 0.1 percent")] = 1e-3
    steepening: Literal["along-ray", "along-axis"] = "along-ray"
    source: Literal["bowl", "projected"] = "bowl"

    @model_validator(mode="after")
    def _choices_fit(self) -> "AcousticsSection":
        if self.nonlinear is False and self.harmonics is not None:
            raise ValueError(
                f"harmonics {self.harmonics} cannot be carried by linear sound; leave harmonics out or set nonlinear = "
                "true"
            )
        if self.nonlinear is False and "steepening" in self.model_fields_set:
            raise ValueError("linear sound does not steepen; leave steepening out or set nonlinear = true")
        if self.diffraction != "exact" and "steepening" in self.model_fields_set and self.steepening == "along-ray":
            raise ValueError(
                f'steepening "along-ray" needs diffraction "exact": "{self.diffraction}" has only "along-axis"'
            )
        return self

    def operator(self) -> Diffraction:
        """The one-way operator."""
        if self.diffraction == "exact":
            return ExactOneWay(steepening_along_ray=self.steepening == "along-ray")
        return {"pade12": Pade12, "pade11": Pade11, "parabolic": Parabolic}[self.diffraction]()

    def discretise(
        self,
        model: Model,
        temperature: float,
        *,
        nonlinear: bool = False,
        say: Callable[[str], None] = lambda _: None,
    ) -> Discretisation:
        """Grids, mesh and steps for a model, the sound field's chosen with all tissue at `temperature` [degC].

        Linear sound needs no choice: there the march is that of `discretise`.

        Args:
            model: The model; its own power is what harmonics and steps are chosen for.
            temperature: Of all tissue [degC].
            nonlinear: What is taken where the file does not say.
            say: Told what is being tried.
        """
        settings = self.start(model, nonlinear=nonlinear)
        if settings.march.n_harmonics == 1:
            return settings
        return self.solve(model, temperature, settings, r=np.zeros(1), z=settings.heat_grid.z[-1:], say=say)[1]

    def solve(
        self,
        model: Model,
        temperature: float,
        settings: Discretisation | None = None,
        *,
        r: Float[np.ndarray, " r"],
        z: Float[np.ndarray, " z"],
        nonlinear: bool = True,
        say: Callable[[str], None] = lambda _: None,
    ) -> tuple[HarmonicField, Discretisation]:
        """The field at radii r and depths z [m] to the tolerance, and the discretisation that this took.

        Not for `jit`; with `harmonics` given, only steps and terms are chosen.
        """
        settings = self.start(model, nonlinear=nonlinear) if settings is None else settings
        field, march = solve_to_tolerance(
            settings.source(model),
            model.drive,
            layers_at(model, temperature, temperature),
            r=r,
            z=z,
            tolerance=self.tolerance,
            diffraction=settings.diffraction,
            settings=settings.march,
            keeps_harmonics=self.harmonics is not None,
            say=say,
        )
        shortcoming = field.convergence.shortcoming(self.tolerance)
        return field, dataclasses.replace(settings, march=march, shortcoming=shortcoming)

    def start(self, model: Model, *, nonlinear: bool) -> Discretisation:
        """The discretisation with which the choice begins; `nonlinear` is taken where the file does not say."""
        settings = discretise(model)
        n_harmonics = 1
        if nonlinear if self.nonlinear is None else self.nonlinear:
            n_harmonics = _FIRST_HARMONICS if self.harmonics is None else self.harmonics
        return dataclasses.replace(
            settings,
            march=dataclasses.replace(settings.march, n_harmonics=n_harmonics),
            diffraction=self.operator(),
            source_plane=float(model.bowl.rim_depth) if self.source == "projected" else None,
        )
