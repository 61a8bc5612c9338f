"""The paper's own arithmetic, recomputed: each number is one that can be checked by hand from its tables."""

import numpy as np
import pytest

from arfjax import suomi2016
from inverse import reproduction


def by_quantity(rows):
    return {row.quantity: row for row in rows}


def test_polynomial_is_not_100_percent_where_it_is_normalised():
    row = by_quantity(reproduction.attenuation_rows())["attenuation polynomial at 37 degC"]
    assert row.here == pytest.approx(97.0887, abs=1e-3)
    # Half a unit of each coefficient's last printed digit: 0.5 + 0.005 T + 0.0005 T^2 + 5e-6 T^3 + 5e-9 T^4.
    assert row.tolerance == pytest.approx(0.5 + 0.185 + 0.6845 + 0.253265 + 0.0093708, rel=1e-4)
    assert row.verdict == "differs"


@pytest.mark.parametrize(
    ("quantity", "here", "verdict"),
    [
        # Z50 at 0.1 Hz: |8 + 14992 i x / (1 + i x)| with x = 2 pi 0.1 0.462 = 0.2903.
        ("|M| of the zener model at 50 degC, 0.1 Hz", 4.18, "differs"),
        ("|M| of the fractional-zener model at 50 degC, 200 Hz", 19.6, "differs"),
        ("|M| of the fractional-zener model at 65 degC, 200 Hz", 143.7, "agrees"),
        ("|M| of the fractional-zener model at 80 degC, 200 Hz", 199.5, "agrees"),
    ],
)
def test_moduli_that_the_text_reads_off(quantity, here, verdict):
    row = by_quantity(reproduction.modulus_rows())[quantity]
    assert row.here == pytest.approx(here, abs=0.06)
    assert row.verdict == verdict


def test_table_3_is_a_regression_through_table_2():
    rows = by_quantity(reproduction.lesion_constant_rows())
    for temperature, stiffness, relaxation in ((60, 34.74, 0.625), (65, 52.65, 0.698), (70, 79.77, 0.771)):
        assert rows[f"lesion M_inf - M_0 at {temperature} degC"].here == pytest.approx(stiffness, abs=0.01)
        assert rows[f"lesion relaxation time at {temperature} degC"].here == pytest.approx(relaxation, abs=1e-3)
    assert {row.verdict for row in rows.values()} == {"agrees"}


def test_the_lethal_dose_comes_before_the_lesion():
    (row,) = reproduction.dose_rows()
    assert row.here == pytest.approx(55.5, abs=0.05)
    assert row.verdict == "agrees"  # within the step of 5 degC


def test_order_one_is_the_conventional_solid():
    row = suomi2016.TABLE_2_ZENER[65.0]
    frequency = np.asarray([0.1, 3.0, 200.0])
    almost = row._replace(fractional_order=1.0 - 1e-12)
    np.testing.assert_allclose(
        reproduction.modulus_magnitude(almost, frequency), reproduction.modulus_magnitude(row, frequency), rtol=1e-9
    )
