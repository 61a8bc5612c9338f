"""Real measurements: published fits of the same data, and what the fractional solid gains on them."""

import csv

import numpy as np
import pytest

from arfjax import FractionalZener, complex_modulus
from inverse.datasets.dma import dma_data, group_sweeps, read_dma
from inverse.datasets.shipped import shipped
from inverse.dma_fit import CONVENTIONAL, FRACTIONAL, fit_sweeps
from inverse.dma_residuals import LogModulus
from inverse.inference.dma import dma_problem
from inverse.inference.identifiability import identify

OMEGA = 10.0
VISITED_TWICE = 59.0
"""Above it [degC] the file holds a second visit, after which the foam had changed."""


def published() -> list[dict[str, float]]:
    with (shipped("nist_foam").parent / "published_sls.csv").open(encoding="utf-8") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def means() -> dict[tuple[float, int], tuple[complex, complex, int]]:
    """Mean complex modulus [Pa], its scatter and the number of rows by dose [Gy] and temperature [degC]."""
    data = read_dma(shipped("nist_foam"))
    assert data.storage_modulus is not None and data.loss_modulus is not None
    dose = np.array([1e3 * float(name.split()[1]) for name in data.sample])
    place = np.round(data.temperature_c).astype(int)
    modulus = data.storage_modulus + 1j * data.loss_modulus
    found = {}
    for key in set(zip(dose.tolist(), place.tolist(), strict=True)):
        rows = modulus[(dose == key[0]) & (place == key[1])]
        found[key] = (complex(rows.mean()), complex(rows.real.std() + 1j * rows.imag.std()), len(rows))
    return found


def test_published_constants_of_the_foam_are_those_of_a_maxwell_element():
    """Relaxation time E' / (omega E'') and branch modulus |E|^2 / E', to the scatter of the repeats or 1e-3."""
    measured, compared = means(), 0
    for row in published():
        key = (row["dose_Gy"], round(row["temp_C"]))
        if key not in measured or row["temp_C"] > VISITED_TWICE:
            continue
        modulus, scatter, _ = measured[key]
        relative = max(scatter.real / modulus.real, scatter.imag / modulus.imag)
        tolerance = max(2.0 * relative, 1e-3)
        np.testing.assert_allclose(row["tau_s"], modulus.real / (OMEGA * modulus.imag), rtol=tolerance)
        np.testing.assert_allclose(row["E0_Pa"] * row["gamma_Eratio"], abs(modulus) ** 2 / modulus.real, rtol=tolerance)
        compared += 1
    assert compared > 50


def test_so_that_the_published_solid_is_too_stiff_by_its_own_long_term_modulus():
    """With the relaxed modulus added, as a standard linear solid has it, storage is E0 above the measured one."""
    measured, excess = means(), []
    for row in published():
        key = (row["dose_Gy"], round(row["temp_C"]))
        if key not in measured or not 0.0 < row["temp_C"] < VISITED_TWICE:
            continue
        modulus, scatter, count = measured[key]
        branch = row["E0_Pa"] * row["gamma_Eratio"]
        solid = FractionalZener(row["E0_Pa"], row["E0_Pa"] + branch, row["tau_s"], 1.0)
        predicted = complex(np.asarray(complex_modulus(solid, np.asarray([OMEGA])))[0])
        excess.append((predicted.real - modulus.real) / row["E0_Pa"])
        np.testing.assert_allclose(predicted.imag, modulus.imag, rtol=max(2.0 * scatter.imag / modulus.imag, 5e-3))
    np.testing.assert_allclose(np.median(excess), 1.0, atol=0.01)


def test_one_frequency_does_not_fix_a_standard_linear_solid():
    """Two data for three constants: something stays free whatever the values."""
    sweep = group_sweeps(dma_data(np.full(2, OMEGA / (2.0 * np.pi)), np.full(2, 20.0), np.full((2, 2), [6.9e6, 3.0e6])))
    problem = dma_problem(sweep, fractional=False, with_priors=False, estimate_noise=False)
    found = identify(problem, np.array([2.5e5, 8.2e6, 0.22]))
    assert found.rank <= 2 and found.sentences


@pytest.fixture(scope="module")
def polymer():
    sweeps = group_sweeps(read_dma(shipped("pyvisco_polymer")))
    return fit_sweeps(sweeps, models=(CONVENTIONAL, FRACTIONAL), residuals=(LogModulus(),))


def test_the_fractional_solid_fits_the_polymer_five_times_better(polymer):
    """Root mean square of the relative error over all 21 sweeps, each model with its own constants in each."""
    total = {
        model.name: np.sqrt(sum(fit.sse_log for fit in polymer.select(model=model)))
        for model in (CONVENTIONAL, FRACTIONAL)
    }
    ratio = total["zener"] / total["fractional"]
    assert ratio > 5.0, f"{ratio:.2f}"


def test_every_temperature_of_the_polymer_is_fitted(polymer):
    assert len(polymer.fits) == 42 and not polymer.unfitted
    assert all(fit.converged for fit in polymer.fits)
