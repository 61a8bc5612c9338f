"""The paper's own arithmetic, recomputed: each number is one that can be checked by hand from its tables."""

import csv
import math

import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import StepwiseResult, suomi2016
from inverse import reproduction
from inverse.commands import reproduction_report
from inverse.commands.main import run
from inverse.commands.reproduction_report import write_readings, write_rows, write_variations
from inverse.datasets.hmi import read_hmi
from inverse.datasets.shipped import shipped
from inverse.reproduction import Case, Reading, SecondStudy, Variation
from inverse.reproduction.row import Row, half_of_last_digit


def by_quantity(rows):
    found = {row.quantity: row for row in rows}
    assert len(found) == len(rows)
    return found


def test_polynomial_is_not_100_percent_where_it_is_normalised():
    rows = by_quantity(reproduction.attenuation_rows())
    row = rows["attenuation polynomial at 37 degC"]
    assert row.here == pytest.approx(97.0887, abs=1e-3)
    # Half a unit of each coefficient's last printed digit: 0.5 + 0.005 T + 0.0005 T^2 + 5e-6 T^3 + 5e-9 T^4.
    assert row.tolerance == pytest.approx(0.5 + 0.185 + 0.6845 + 0.253265 + 0.0093708, rel=1e-4)
    assert row.verdict == "differs"
    assert rows["attenuation polynomial at 35 degC"].here == pytest.approx(99.3, abs=0.05)
    where, lowest = reproduction.lowest_of_polynomial()
    assert (where, lowest) == (pytest.approx(44.1, abs=0.05), pytest.approx(93.3, abs=0.05))


def test_below_60_degc_the_simulated_curve_is_attenuation_alone():
    percent = 100.0 * reproduction.force_of_plane_wave(np.asarray([40.0, 45.0, 50.0, 55.0]))
    np.testing.assert_allclose(percent, [96.1, 95.0, 97.7, 105.0], atol=0.05)


@pytest.mark.parametrize(
    ("quantity", "here", "verdict"),
    [
        # Z50 at 0.1 Hz: |8 + 14992 i x / (1 + i x)| with x = 2 pi 0.1 0.462 = 0.2903.
        ("|M| of the zener model at 50 degC, 0.1 Hz", 4.18, "differs"),
        ("|M| of the fractional-zener model at 21 degC, 200 Hz", 2.52, "differs"),
        ("|M| of the fractional-zener model at 50 degC, 200 Hz", 19.6, "differs"),
        ("|M| of the fractional-zener model at 65 degC, 200 Hz", 143.7, "agrees"),
        ("|M| of the fractional-zener model at 80 degC, 200 Hz", 199.5, "agrees"),
        ("M_0 of the zener model at 50 degC", 2850.0, "differs"),
        ("tan delta of the zener model at 50 degC, 0.1 Hz", 3.4, "not stated"),
        ("tan delta of the zener model at 65 degC, 0.1 Hz", 2.4, "not stated"),
        ("tan delta of the zener model at 80 degC, 0.1 Hz", 1.7, "not stated"),
    ],
)
def test_moduli_that_the_text_reads_off(quantity, here, verdict):
    row = by_quantity(reproduction.modulus_rows())[quantity]
    assert row.here == pytest.approx(here, abs=max(half_of_last_digit(here), 0.005))
    assert row.verdict == verdict


def test_rounding_of_the_table_does_not_explain_the_text():
    """2.4 kPa is stated where the row allows 2.48 to 2.56 by its M_inf."""
    low, high = reproduction.modulus_from_rounding(suomi2016.TABLE_2_FRACTIONAL_ZENER[21.0], 200.0)
    assert 2.45e3 < low < 2.5167e3 < high < 2.57e3


def test_order_one_is_the_conventional_solid():
    row = suomi2016.TABLE_2_ZENER[65.0]
    frequency = np.asarray([0.1, 3.0, 200.0])
    almost = row._replace(fractional_order=1.0 - 1e-12)
    np.testing.assert_allclose(
        reproduction.modulus_magnitude(almost, frequency), reproduction.modulus_magnitude(row, frequency), rtol=1e-9
    )


def test_a_relaxed_modulus_gives_the_magnitude_that_it_was_found_for():
    row = suomi2016.TABLE_2_ZENER[50.0]
    needed = reproduction.relaxed_modulus_for(row, 0.1, 5e3)
    again = reproduction.modulus_magnitude(row._replace(relaxed_modulus_pa=needed), np.asarray([0.1]))
    assert again[0] == pytest.approx(5e3, rel=1e-12)


def test_sse_is_relative_on_four_points_a_decade():
    table, targets = suomi2016.TABLE_2_ZENER, suomi2016.TABLE_2_FRACTIONAL_ZENER
    grids = [reproduction.fitted_frequencies(row) for row in table.values()]
    assert [len(grid) for grid in grids] == [8, 10, 11, 12, 13]
    ends = [row.highest_frequency_hz for row in table.values()]
    np.testing.assert_allclose([grid[-1] for grid in grids], ends, rtol=5e-3)
    here = [
        reproduction.sum_of_squares(row, targets[t], grid) for (t, row), grid in zip(table.items(), grids, strict=True)
    ]
    np.testing.assert_allclose(here, [0.0081, 0.0315, 0.266, 0.365, 0.365], rtol=5e-3)
    absolute = reproduction.sum_of_squares(table[80.0], targets[80.0], grids[-1], relative=False)
    assert 1e3 < absolute / 0.366 < 1e5  # what kPa^2 would give


@pytest.mark.parametrize(
    ("temperature", "held", "freed"),
    [
        (50.0, (15.0, 0.449), (5.7, 0.061)),
        (65.0, (98.8, 0.677), (57.0, 0.072)),
        (80.0, (138.0, 0.904), (95.0, 0.068)),
    ],
)
def test_hot_rows_are_not_the_optimum(temperature, held, freed):
    with_eight = reproduction.refit(temperature, frees_relaxed_modulus=False)
    assert with_eight.unrelaxed_modulus_kpa == pytest.approx(held[0], abs=0.05)
    assert with_eight.relaxation_time == pytest.approx(held[1], abs=5e-4)
    free = reproduction.refit(temperature, frees_relaxed_modulus=True)
    assert 1e-3 * free.relaxed_modulus_pa == pytest.approx(freed[0], abs=half_of_last_digit(freed[0]))
    assert free.sum_of_squares == pytest.approx(freed[1], abs=5e-4)
    assert free.sum_of_squares < 0.3 * with_eight.sum_of_squares


def test_two_magnitudes_are_3_to_183_times_and_5_to_36():
    printed = reproduction.error_ratios().values()
    assert (min(printed), max(printed)) == (pytest.approx(3.1, abs=0.05), pytest.approx(183.0, abs=0.5))
    freed = [ratio for t, ratio in reproduction.error_ratios(frees_relaxed_modulus=True).items() if t >= 50.0]
    assert (min(freed), max(freed)) == (pytest.approx(5.5, abs=0.05), pytest.approx(36.0, abs=0.5))


def test_the_slope_in_the_relaxed_modulus_vanishes_at_zero():
    """|M|^2 = (M_0^2 + x^2 M_inf^2) / (1 + x^2): halving M_0 quarters its effect, so that no score test can find it."""
    row = suomi2016.TABLE_2_ZENER[50.0]
    at = reproduction.fitted_frequencies(row)
    none, half, whole = (
        reproduction.modulus_magnitude(row._replace(relaxed_modulus_pa=relaxed), at) for relaxed in (0.0, 4.0, 8.0)
    )
    np.testing.assert_allclose((whole - none) / (half - none), 4.0, rtol=1e-2)


def test_rows_of_8_pa_do_not_determine_it():
    conventional = [reproduction.relaxed_modulus_uncertainty(row) for row in suomi2016.TABLE_2_ZENER.values()]
    fractional = [reproduction.relaxed_modulus_uncertainty(row) for row in suomi2016.TABLE_2_FRACTIONAL_ZENER.values()]
    assert max(*conventional[:2], fractional[0]) < 1.0  # rows of kilopascals do
    assert min(conventional[2:]) > 1e4
    assert 100.0 < min(fractional[1:]) < max(fractional) < 2e4
    with_phase = reproduction.relaxed_modulus_uncertainty(suomi2016.TABLE_2_ZENER[50.0], phase=True)
    assert with_phase < 1e-2 * conventional[2]


def test_uncertainty_of_a_well_known_constant_is_that_of_repeated_fits():
    """The Fisher bound of Z21 against the scatter of a thousand fits in the linear regime."""
    row = suomi2016.TABLE_2_ZENER[21.0]
    at = reproduction.fitted_frequencies(row)
    constants = np.log([row.relaxed_modulus_pa, 1e3 * row.unrelaxed_modulus_kpa, row.relaxation_time])

    def logarithm(values):
        relaxed, unrelaxed, time = np.exp(values)
        squared = (2.0 * math.pi * at * time) ** 2
        return 0.5 * np.log((relaxed**2 + squared * unrelaxed**2) / (1.0 + squared))

    slopes = np.stack([(logarithm(constants + h) - logarithm(constants - h)) / 2e-5 for h in 1e-5 * np.eye(3)], axis=1)
    noise = np.random.default_rng(0).normal(scale=0.02, size=(len(at), 4000))
    scatter = np.std(np.linalg.lstsq(slopes, noise, rcond=None)[0][0])
    assert reproduction.relaxed_modulus_uncertainty(row) == pytest.approx(scatter, rel=0.05)


def test_table_3_is_a_regression_through_table_2():
    rows = by_quantity(reproduction.lesion_constant_rows())
    for temperature, stiffness, relaxation in ((60, 34.74, 0.625), (65, 52.65, 0.698), (70, 79.77, 0.771)):
        for name, expected, unit in (
            ("M_inf - M_0", stiffness, 0.01),
            ("relaxation time", relaxation, 1e-3),
        ):
            row = rows[f"lesion {name} at {temperature} degC"]
            assert row.here == pytest.approx(expected, abs=unit) and row.verdict == "agrees"
    assert rows["liver M_0 (printed in Pa)"].here == pytest.approx(1100.0)
    assert rows["lesion stiffness at 65 degC, the fit at that temperature"].here == pytest.approx(52.6 / 0.53, rel=5e-3)
    assert reproduction.mean_relaxed_modulus() == pytest.approx(495.0, abs=1.0)


def test_the_push_is_far_shorter_than_the_relaxation():
    assert reproduction.relaxed_share(0.626) == pytest.approx(0.5e-3 / 0.626, rel=1e-3)


def test_the_lethal_dose_comes_before_the_lesion():
    (row,) = reproduction.dose_rows()
    assert row.here == pytest.approx(55.5, abs=0.05)
    assert row.verdict == "agrees"  # within the step of 5 degC


def test_counts():
    rows = [row.here for row in reproduction.count_rows(read_hmi(shipped("suomi2016_hmi")))]
    np.testing.assert_allclose(rows, [12.7, 38.1, 4.2, 11.1, 2.0, 33.3], atol=0.05)
    falls, rises, _ = reproduction.falls_and_rises(read_hmi(shipped("suomi2016_hmi")))
    np.testing.assert_allclose(falls, [12.7, 38.1, 35.0], atol=0.05)
    np.testing.assert_allclose(rises, [11.1, 6.1, 4.2], atol=0.05)


def test_the_water_of_table_1_is_at_20_degc():
    (row,) = reproduction.layer_rows()
    assert row.here == pytest.approx(20.0, abs=0.5) and row.verdict == "differs"
    assert reproduction.water_sound_speed(25.0) == pytest.approx(1496.7, abs=0.05)  # a handbook's value


def power_law() -> SecondStudy:
    """Displacement that goes as the inverse of the modulus and falls exponentially with attenuation."""
    modulus, attenuation = np.geomspace(5.0, 155.0, 40), np.linspace(0.3, 1.5, 25)
    return SecondStudy(modulus, attenuation, 1e-6 / modulus[:, None] * np.exp(-2.0 * attenuation)[None, :])


def test_the_second_study_on_a_map_that_is_a_power_law():
    """Between its points the map is exact, since its logarithm is linear in those of the modulus and in attenuation."""
    study, table = power_law(), suomi2016.TABLE_1_ACOUSTIC["liver"].attenuation_db_per_cm_mhz
    rise = suomi2016.TEXT_ABLATION_ATTENUATION_RATIO
    assert rise == pytest.approx(2.1)
    assert study.at(17.0, 0.77) == pytest.approx(1e-6 / 17.0 * np.exp(-1.54), rel=1e-9)
    softened = np.exp(-2.0 * (rise - 1.0) * table)
    assert study.ratio(10.0, 4.0) == pytest.approx(softened / 4.0, rel=1e-9)
    assert study.factor_for(0.5 * softened, 10.0) == pytest.approx(2.0, rel=1e-4)
    assert np.isnan(study.factor_for(2.0 * softened, 10.0)) and np.isnan(study.factor_for(0.01 * softened, 10.0))
    assert study.power_for(9e-6, 10.0) == pytest.approx(90.0 * np.exp(2.0 * table), rel=1e-9)
    data = study.dataset()
    np.testing.assert_allclose(data["branch_modulus"][[0, -1]], [5e3, 155e3])
    # A decibel per centimetre is ln(10) / 20 nepers in a hundredth of a metre.
    np.testing.assert_allclose(data["attenuation"][0], 0.3 * 100.0 * np.log(10.0) / 20.0, rtol=1e-12)


def test_misfit_of_a_reading_is_the_root_mean_square_at_the_stated_temperatures():
    stated = suomi2016.TEXT_SIMULATED_DISPLACEMENT_PERCENT
    percent = tuple(stated.get(temperature, 0.0) for temperature in reproduction.TEMPERATURES)
    exact = Reading("beam", Case(), percent, 1e-6)
    assert exact.misfit == 0.0 and exact.at(70.0) == stated[70.0]
    away = tuple(
        value - 10.0 if t == 70.0 else value for t, value in zip(reproduction.TEMPERATURES, percent, strict=True)
    )
    off = Reading("beam", Case("dose"), away, 2e-6)
    assert off.misfit == pytest.approx(10.0 / np.sqrt(len(stated)))
    assert reproduction.find([exact, off], "be", Case("dose")) is off
    forces = {t: jnp.asarray([[1.0, 2.0]]) * (1.0 + 0.01 * (t - 35.0)) for t in reproduction.TEMPERATURES}
    read = reproduction.reading("b", Case(), {t: jnp.asarray([[3.0, 0.5]]) for t in reproduction.TEMPERATURES}, forces)
    assert read.first_displacement == pytest.approx(4.0) and read.at(60.0) == pytest.approx(125.0)


def test_measured_values_are_compared_in_percent_of_37_degc(tmp_path):
    """A stepwise curve that falls by one per kelvin from 100 at 35 degC, and a watched one that ends at 45."""
    temperature = jnp.asarray([35.0, 37.0, 55.0])
    moved = 1e-8 * (135.0 - temperature)
    pushed = StepwiseResult(temperature, temperature, jnp.stack([0.0 * moved, moved], axis=1), *2 * [0.0 * moved])
    path = tmp_path / "hmi.csv"
    path.write_text("sonication,temperature_c,displacement_percent\n1,40,97\n1,50,80\n2,60,70\n")
    rows = by_quantity(reproduction.measured_rows(read_hmi(path), pushed, {37.0: 200.0, 45.0: 184.0}))
    assert {name: (row.paper, row.here) for name, row in rows.items()} == {
        "sonication 1 at 40 degC, stepwise pushes": (97.0, pytest.approx(100.0 * 95.0 / 98.0)),
        "sonication 1 at 40 degC, transient, 50 Hz": (97.0, pytest.approx(100.0 * 194.0 / 200.0)),
        "sonication 1 at 50 degC, stepwise pushes": (80.0, pytest.approx(100.0 * 85.0 / 98.0)),
    }
    here = reproduction.percent_of_first(pushed)
    assert here == {35.0: pytest.approx(100.0), 37.0: pytest.approx(98.0), 55.0: pytest.approx(80.0)}


def test_size_of_a_beam_is_where_it_has_fallen_to_a_quarter():
    """Of a Gaussian off the middle of the map: exp(-x^2 / a^2) is a quarter at a sqrt(ln 4) on both sides."""
    r, z = np.linspace(0.0, 3e-3, 61), np.linspace(-5e-3, 13e-3, 121)
    found = reproduction.beam_size(r, z, 7.0 * np.exp(-((r[:, None] / 1e-3) ** 2) - ((z[None, :] - 1e-3) / 4e-3) ** 2))
    np.testing.assert_allclose(found, 2.0 * np.sqrt(np.log(4.0)) * np.array([1e-3, 4e-3]), rtol=3e-3)


def test_a_beam_that_the_map_cuts_off_has_no_size():
    """Rather than one between the map's ends."""
    r, z = np.linspace(0.0, 3e-3, 61), np.linspace(-13e-3, 13e-3, 121)
    found = reproduction.beam_size(r, z, np.exp(-((r[:, None] / 1e-3) ** 2) - (z[None, :] / 4e-2) ** 2))
    np.testing.assert_allclose(found.width, 2e-3 * np.sqrt(np.log(4.0)), rtol=3e-3)
    assert np.isnan(found.length)


@pytest.mark.parametrize(
    ("section", "key"),
    [
        ('[mechanics]\nmodulus = "shear"', "mechanics.modulus"),
        ('[lesion]\nedge = "sharp"', "lesion.edge"),
        ("[acoustics]\nnonlinear = true", "acoustics.nonlinear"),
    ],
)
def test_readings_that_are_tried_anyway_are_not_the_file_s_to_choose(section, key, tmp_path, capsys):
    """Half of the rows would be of the file's, half of the paper's."""
    lines = shipped("suomi2016_experiment").read_text().splitlines()
    name = section.splitlines()[0]
    if name in lines:
        begun = lines.index(name)
        lines[begun : begun + 1] = [*section.splitlines()]
        wanted = section.splitlines()[1].split(" = ")[0]
        lines = [line for i, line in enumerate(lines) if i <= begun + 1 or not line.startswith(f"{wanted} =")]
    else:
        lines += section.splitlines()
    (tmp_path / "e.toml").write_text("\n".join(lines))
    assert run(["reproduce", "--experiment", str(tmp_path / "e.toml"), "--out", str(tmp_path / "out")]) == 2
    assert f"{key} is" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_the_largest_variation_is_that_which_moves_most_either_way():
    """And the row of the paper's statement says how far, without a sign."""
    found = [
        Variation("dose", temperature, what, change, points)
        for what, points_at in (
            ("modulus", ((-1.0, 0.5), (-2.0, 1.9), (1.5, -3.0))),
            ("attenuation", ((-6.0, 5.0), (-7.0, 6.5), (4.0, -20.0))),
            ("attenuation, force only", ((0.1, 0.1), (0.1, 0.1), (0.1, -21.0))),
            ("attenuation, path only", ((0.1, 0.1), (0.1, 0.1), (0.1, 0.75))),
            ("attenuation, linear edge", ((1.0, -1.0), (1.0, -1.0), (1.0, -7.5))),
            ("sound speed", ((0.1, 0.2), (0.3, -3.25), (0.1, 0.1))),
            ("exponent", ((0.1, 0.2), (0.3, -0.4), (0.1, 0.1))),
        )
        for temperature, ends in zip((60.0, 65.0, 70.0), points_at, strict=True)
        for change, points in zip((-0.25, 0.25), ends, strict=True)
    ]
    assert reproduction.largest(found, "attenuation").points == -20.0
    assert reproduction.largest(found, "attenuation", 65.0).points == -7.0
    rows = by_quantity(reproduction.variation_rows(found))
    here = {name: (row.here, row.verdict) for name, row in rows.items()}
    assert here["displacement, lesion's attenuation +-25 percent, lesion by dose"] == (20.0, "differs")
    assert here["displacement at 70 degC, lesion's modulus +-25 percent, lesion by dose"][0] == 3.0
    assert here["displacement, lesion's sound speed +-0.5 percent, lesion by dose"] == (3.25, "differs")
    assert here["displacement, lesion's exponent +-25 percent, lesion by dose"] == (0.4, "agrees")
    why = rows["displacement, lesion's attenuation +-25 percent, lesion by dose"].why
    assert "70 degC (+25 percent: -20.00): the local force alone 21.00, the path through the lesion alone 0.75" in why


def test_tables_of_the_reproduction_hold_what_is_compared(tmp_path):
    rows = [Row("dose", "a", 50.0, 48.5, "degC", 1.0, "because"), Row("dose", "b", None, 2.0, "mm", 0.0, "so")]
    write_rows(tmp_path / "rows.csv", rows)
    first, second = csv.DictReader((tmp_path / "rows.csv").read_text().splitlines())
    assert (first["paper"], first["here"], first["difference"], first["verdict"]) == ("50", "48.5", "-1.5", "differs")
    assert (second["paper"], second["here"], second["difference"], second["verdict"]) == ("", "2", "", "not stated")
    percent = tuple(float(number) for number in range(100, 92, -1))
    write_readings(tmp_path / "readings.csv", [Reading("bowl", Case("dose", "sharp"), percent, 3e-6)])
    paper, ours = csv.DictReader((tmp_path / "readings.csv").read_text().splitlines())
    assert paper["percent_at_70_degc"] == "49" and paper["percent_at_50_degc"] == ""
    assert (ours["lesion"], ours["edge"], ours["percent_at_35_degc"], ours["percent_at_70_degc"]) == (
        "dose", "sharp", "100.00", "93.00",
    )  # fmt: skip
    assert ours["displacement_at_35_degc_um"] == "3"
    write_variations(tmp_path / "variations.csv", [Variation("dose", 65.0, "modulus", -0.25, 1.5)])
    (one,) = csv.DictReader((tmp_path / "variations.csv").read_text().splitlines())
    assert (one["temperature_degc"], one["change_percent"], one["points"]) == ("65", "-25", "+1.500")
    text = reproduction_report.report(rows, [Reading("bowl", Case(), percent, 3e-6)], [], ["a note"])
    assert "0 of 1 numbers agree within the paper's rounding." in text and "- a note" in text
    assert "| a | 50 | 48.5 | -1.5 | degC | differs | because |" in text


def test_a_number_that_the_paper_does_not_give_has_no_verdict():
    row = Row("section", "quantity", None, 1.0, "m", 0.0, "computed")
    assert row.difference is None and row.verdict == "not stated"


@pytest.mark.parametrize(("stated", "half"), [(40.0, 5.0), (19.0, 0.5), (2.4, 0.05), (100.0, 50.0), (0.1, 0.05)])
def test_what_the_last_digit_leaves_open(stated, half):
    assert half_of_last_digit(stated) == pytest.approx(half)
