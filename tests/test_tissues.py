"""Named tissues: what their laws state, and what heat and dose do to them."""

import dataclasses
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import suomi2016, tissues
from arfjax.errors import ExtrapolationWarning
from arfjax.laws import Linear, TemperatureLaw
from arfjax.tissues import Tissue

UNITS = {
    "density": "kg/m^3",
    "sound_speed": "m/s",
    "attenuation": "Np/m",
    "absorption_exponent": "1",
    "conductivity": "W/(m K)",
    "specific_heat": "J/(kg K)",
    "perfusion_rate": "1/s",
    "metabolic_heat": "W/m^3",
    "absorption_fraction": "1",
}
VARIANTS = {
    "as named": lambda tissue: tissue,
    "unperfused": tissues.unperfused,
    "coagulating": tissues.coagulating,
    "warming": tissues.warming,
}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", tissues.BY_NAME)
def test_every_property_is_a_law_with_its_unit_and_source(name, variant):
    tissue = VARIANTS[variant](tissues.BY_NAME[name]())
    for field in dataclasses.fields(Tissue):
        law = getattr(tissue, field.name)
        if field.name in UNITS:
            assert isinstance(law, TemperatureLaw) and law.unit == UNITS[field.name] and law.source
            assert float(law.evaluate(40.0)) >= 0.0
        else:
            assert field.name in {"nonlinearity_parameter", "viscoelasticity"}


@pytest.mark.parametrize("name", tissues.BY_NAME)
def test_acoustic_constants_are_table_1(name):
    row, medium = suomi2016.TABLE_1_ACOUSTIC[name], tissues.BY_NAME[name]().acoustic(35.0)
    assert float(medium.density) == row.density and float(medium.sound_speed) == row.sound_speed
    assert float(medium.absorption_exponent) == row.absorption_exponent


def test_thermal_constants_are_made_of_the_laws_at_that_temperature_and_dose():
    """Density times specific heat, blood's heat capacity times perfusion; laws of both arguments reach all of them."""
    tissue = tissues.coagulating(tissues.warming(tissues.liver()))
    made = Linear(100.0, 3.0, 37.0, unit="W/m^3", source="test")
    denser = Linear(1060.0, -0.5, 37.0, unit="kg/m^3", source="test")
    tissue = dataclasses.replace(tissue, density=denser, metabolic_heat=made)
    temperature, dose = jnp.asarray([40.0, 65.0]), jnp.asarray([0.0, 240.0])
    medium = tissue.thermal(temperature, dose)
    slope = (4187.0 - 3411.0) / 58.5
    capacity = [1058.5 * (3411.0 + 15.0 * slope), 1046.0 * (3411.0 + 40.0 * slope)]
    np.testing.assert_allclose(medium.heat_capacity, capacity, rtol=1e-13)
    np.testing.assert_allclose(medium.conductivity, [0.520, 0.520 * 1.225], rtol=1e-13)
    np.testing.assert_allclose(medium.perfusion_conductance, [15.2 * 3617.0, 7.6 * 3617.0], rtol=1e-13)
    np.testing.assert_allclose(medium.metabolic_heat, [109.0, 184.0], rtol=1e-13)
    assert float(tissue.acoustic(65.0, 240.0).density) == 1046.0


def test_perfusion_stops_where_tissue_coagulates():
    liver = tissues.liver()
    fresh, stopping = float(liver.perfusion_rate(37.0)), tissues.coagulating(liver).perfusion_rate
    assert fresh == pytest.approx(15.2 / 1050.0)
    shares = [
        float(stopping(60.0, dose)) / fresh for dose in (0.0, 10.0, 240.0 / 9.0**0.25, 240.0, 240.0 * 9.0**0.25, 1e5)
    ]
    np.testing.assert_allclose(shares, [1.0, 1.0, 0.9, 0.5, 0.1, 0.0], atol=1e-5)
    assert float(stopping(60.0)) == fresh
    steep = tissues.coagulating(liver, width=0.01).perfusion_rate
    assert float(steep(60.0, 230.0)) > 0.98 * fresh and float(steep(60.0, 250.0)) < 0.02 * fresh
    assert float(tissues.coagulating(tissues.unperfused(liver)).perfusion_rate(60.0, 100.0)) == 0.0
    other = dataclasses.replace(tissues.coagulating(liver), perfusion_rate=liver.perfusion_rate)
    assert jax.tree.all(jax.tree.map(lambda one, two: bool(np.all(one == two)), other, liver))


def test_attenuation_doubles_over_the_doses_that_were_measured():
    """A tenth of the way at 100 min, nine tenths at 1000, so half at their geometric mean; at any temperature."""
    liver = tissues.liver()
    doubling = tissues.attenuating(liver).attenuation
    for temperature in (37.0, 60.0):
        fresh = float(liver.attenuation(temperature))
        grown = [float(doubling(temperature, dose)) / fresh - 1.0 for dose in (0.0, 100.0, 10.0**2.5, 1000.0, 1e10)]
        np.testing.assert_allclose(grown, [0.0, 0.1, 0.5, 0.9, 1.0], rtol=1e-12)


def test_warming_hits_what_was_measured():
    tissue = tissues.warming(tissues.liver())
    conductivity, specific_heat = tissue.conductivity, tissue.specific_heat
    for temperature, value in ((20.0, 0.575), (35.0, 0.520), (37.0, 0.520), (40.0, 0.520), (90.0, 1.45 * 0.520)):
        assert float(conductivity(temperature)) == pytest.approx(value, abs=5e-4)
    assert float(conductivity(35.0) / conductivity(20.0)) == pytest.approx(1.0 - 0.096, rel=1e-12)
    assert float(specific_heat(25.0)) == 3411.0
    assert float(specific_heat(83.5)) == pytest.approx(4187.0, rel=1e-14)


@pytest.mark.parametrize(
    ("name", "inside", "outside"),
    [("conductivity", (20.0, 90.0), (19.0, 91.0)), ("specific_heat", (25.0, 83.5), (24.0, 84.0))],
)
def test_warming_says_where_it_was_not_measured(name, inside, outside):
    law = getattr(tissues.warming(tissues.muscle()), name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        law(jnp.asarray(inside))
    for temperature in outside:
        with pytest.warns(ExtrapolationWarning, match=f"extrapolated to {temperature:g} degC"):
            assert np.isfinite(law(temperature))


def test_all_attenuation_absorbs_unless_said_otherwise():
    liver = tissues.liver()
    assert float(liver.acoustic(50.0).absorption_fraction) == 1.0
    scattering = dataclasses.replace(liver, absorption_fraction=Linear(0.8, -0.01, 37.0, unit="1", source="test"))
    assert float(scattering.acoustic(47.0).absorption_fraction) == pytest.approx(0.7)
