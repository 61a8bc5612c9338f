"""Tissue that varies: the draws, the runs, what they say together, and the command."""

import csv
import dataclasses
import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from arfjax import (
    InputError,
    Layer,
    Phase,
    ShortPush,
    Sonication,
    TransientProtocol,
    discretise,
    read_experiment,
    run_stepwise,
    run_transient,
)
from arfjax.laws import Coagulating, Constant, Linear, ScaledRise
from inverse.commands import variability_report
from inverse.commands.main import run
from inverse.commands.partial import PartialFile
from inverse.commands.vary import Task, _dataset, _write_tables, curve_temperatures
from inverse.monte_carlo import (
    SPREADS,
    analyse,
    draw_factors,
    run_samples,
    stepwise_outcome,
    transient_outcome,
    varied,
)
from inverse.monte_carlo.bands import (
    QUANTILES,
    correlation_noise,
    curves_by_temperature,
    highest_at,
    levels_of,
    rank_correlations,
)

EXPERIMENT = Path(__file__).parents[2] / "examples" / "suomi2016.toml"
DESCRIBED = read_experiment(EXPERIMENT)
PAPERS = DESCRIBED.model()
# Water and liver alone: every layer more takes as long again to compile.
MODEL = dataclasses.replace(PAPERS, path=(Layer(PAPERS.path[0].tissue, PAPERS.liver_depth),))
SETTINGS = discretise(MODEL, refinement=0.4)
STEPWISE = DESCRIBED.stepwise()
TEMPERATURES = [35.0, 50.0, 70.0]
OUTCOME = stepwise_outcome(STEPWISE, TEMPERATURES, SETTINGS)
BY_NAME = {spread.name: spread for spread in SPREADS}


def with_sd(relative_sd: float, *names: str):
    chosen = [BY_NAME[name] for name in names] if names else SPREADS
    return [dataclasses.replace(spread, relative_sd=relative_sd) for spread in chosen]


def outcomes_of(outcome, model, spreads, factors, **options):
    chunks = [found for _, found in run_samples(outcome, model, spreads, factors, **options)]
    return {name: np.concatenate([chunk[name] for chunk in chunks]) for name in chunks[0]}


def cheap_outcome(model):
    """Of constants alone, which takes no time to compile."""
    at = jnp.asarray([60.0, 65.0, 70.0])
    solid = model.lesion.viscoelasticity(at)
    return {
        "displacement": model.liver.attenuation.after(at, 0.0) / solid.unrelaxed_modulus,
        "heating_power": model.liver.sound_speed.after(37.0, 0.0),
    }


def test_a_seed_is_its_draws():
    first, again, other = (draw_factors(SPREADS, 30, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.any(first == other)


@pytest.mark.parametrize("distribution", ["normal", "log-normal"])
def test_draws_have_the_stated_mean_and_spread(distribution):
    """Errors of 4000 independent draws are 1/sqrt(4000) and 1/sqrt(8000) of the spread; strata only lower them."""
    spread = dataclasses.replace(SPREADS[0], relative_sd=0.2, distribution=distribution)
    factors = draw_factors([spread, spread], 4000, 0)
    np.testing.assert_allclose(factors.mean(axis=0), 1.0, atol=3.0 * 0.2 / np.sqrt(4000.0))
    np.testing.assert_allclose(factors.std(axis=0, ddof=1), 0.2, rtol=3.0 * 1.5 / np.sqrt(8000.0))
    assert abs(np.corrcoef(factors.T)[0, 1]) < 4.0 / np.sqrt(4000.0)
    assert factors.min() > 0.0


def test_every_stratum_holds_one_draw():
    spread = dataclasses.replace(SPREADS[0], distribution="log-normal", relative_sd=0.2)
    factors = np.sort(draw_factors([spread], 50, 7)[:, 0])
    edges = spread.factor(np.arange(1, 50) / 50.0)
    np.testing.assert_array_equal(np.searchsorted(edges, factors), np.arange(50))


def test_each_spread_multiplies_its_constant_and_no_other():
    for index, spread in enumerate(SPREADS):
        factors = jnp.ones(len(SPREADS)).at[index].set(1.1)
        changed = varied(MODEL, SPREADS, factors)
        ratios = [other.central(changed) / other.central(MODEL) for other in SPREADS]
        expected = np.where(np.arange(len(SPREADS)) == index, 1.1, 1.0)
        if spread.name == "liver_attenuation":  # what rises is a share of it
            expected[[each.name for each in SPREADS].index("liver_attenuation_rise")] = 1.1
        np.testing.assert_allclose(ratios, expected, rtol=1e-12, err_msg=spread.name)
        assert spread.source and (spread.measured or spread.source.startswith("assumed"))


def test_only_the_rise_of_a_law_is_multiplied():
    rising, falling = (
        ScaledRise(Linear(10.0, slope, 40.0, unit="1", source=""), 1.5, 40.0, unit="1", source="")
        for slope in (2.0, -2.0)
    )
    at = jnp.asarray([30.0, 40.0, 50.0])
    np.testing.assert_allclose(rising(at), [-10.0, 10.0, 40.0])
    np.testing.assert_allclose(falling(at), [30.0, 10.0, -10.0])


def test_the_rise_that_dose_makes_is_multiplied_at_all_temperatures():
    fresh, coagulated = (Constant(value, unit="1", source="") for value in (10.0, 30.0))
    law = ScaledRise(Coagulating(fresh, coagulated, 240.0, 0.25, unit="1", source=""), 1.5, 40.0, unit="1", source="")
    for temperature in (30.0, 60.0):
        np.testing.assert_allclose([law(temperature, 0.0), law(temperature, 240.0)], [10.0, 25.0])


@pytest.mark.slow
def test_no_spread_is_the_protocol_s_own_curve():
    result = eqx.filter_jit(lambda m: run_stepwise(m, jnp.asarray(TEMPERATURES), STEPWISE, SETTINGS))(MODEL)
    spreads = with_sd(0.0)
    found = outcomes_of(OUTCOME, MODEL, spreads, draw_factors(spreads, 2, 0), chunk=2)
    for row in range(2):
        np.testing.assert_allclose(found["displacement"][row], result.displacement, rtol=1e-10)
        np.testing.assert_allclose(found["lesion_length"][row], result.lesion_length, rtol=1e-8, atol=1e-12)


def test_samples_do_not_depend_on_their_chunks():
    """One after the other, a filled-up last chunk, and a run that goes on after two, as one that was stopped does."""
    factors = draw_factors(SPREADS, 5, 3)
    alone = [cheap_outcome(varied(MODEL, SPREADS, jnp.asarray(row))) for row in factors]
    whole = outcomes_of(cheap_outcome, MODEL, SPREADS, factors, chunk=2)
    rest = outcomes_of(cheap_outcome, MODEL, SPREADS, factors, chunk=2, done=2)
    assert whole["displacement"].shape == (5, 3) and len(np.unique(whole["displacement"])) == 15
    for name, values in whole.items():
        np.testing.assert_allclose(values, [each[name] for each in alone], rtol=1e-12)
        np.testing.assert_array_equal(rest[name], values[2:])
    assert list(run_samples(cheap_outcome, MODEL, SPREADS, factors, chunk=2, done=5)) == []


@pytest.mark.slow
def test_small_spreads_are_those_of_the_gradient():
    """Delta method: for a spread of s, the sd of displacement is |gradient| times that of the draws, to order s."""
    relative_sd = 1e-3
    spreads = with_sd(relative_sd, "liver_attenuation_rise", "lesion_modulus")
    factors = draw_factors(spreads, 4, 1)
    found = outcomes_of(OUTCOME, MODEL, spreads, factors, chunk=4)["displacement"][:, -1]
    model = jax.tree.map(jnp.asarray, MODEL)
    gradient = jax.jit(jax.grad(lambda row: OUTCOME(varied(model, spreads, row))["displacement"][-1]))(jnp.ones(2))
    assert np.all(np.asarray(gradient) != 0.0)
    expected = np.std((factors - 1.0) @ np.asarray(gradient), ddof=1)
    np.testing.assert_allclose(np.std(found, ddof=1), expected, rtol=10.0 * relative_sd)


@pytest.mark.slow
def test_no_spread_is_the_watched_sonication_s_own_curve():
    sonication = Sonication((Phase(30.0, 10),), 35.0)
    drive = dataclasses.replace(MODEL.drive, acoustic_power=0.235 * MODEL.drive.acoustic_power)
    model, protocol = dataclasses.replace(MODEL, drive=drive), TransientProtocol(sonication, ShortPush())
    spreads = with_sd(0.0)
    found = outcomes_of(
        transient_outcome(model, protocol, SETTINGS), model, spreads, draw_factors(spreads, 2, 0), chunk=2
    )
    result = eqx.filter_jit(lambda m: run_transient(m, protocol, SETTINGS))(model)
    for row in range(2):
        np.testing.assert_allclose(found["tracked_displacement"][row], result.tracked, rtol=1e-8)
        np.testing.assert_allclose(found["thermocouple_temperature"][row], result.thermocouple_temperature, rtol=1e-9)
    levels = levels_of(found["thermocouple_temperature"], 35.0)
    curve = curves_by_temperature(found["thermocouple_temperature"], found["tracked_displacement"], levels)
    np.testing.assert_allclose(curve[:, 0] / curve[:, 0], 1.0)
    assert levels[-1] > 60.0 and curve[0, -1] < 0.95 * curve[0, 0]


def test_curves_by_temperature_end_where_the_heating_does():
    course = np.array([[37.0, 47.0, 57.0, 50.0], [37.0, 41.0, 45.0, 40.0]])
    found = curves_by_temperature(
        course, np.array([[1.0, 2.0, 4.0, 9.0], [1.0, 5.0, 9.0, 0.0]]), np.array([37.0, 42.0, 52.0])
    )
    np.testing.assert_allclose(found, [[1.0, 1.5, 3.0], [1.0, 6.0, np.nan]])


def test_no_temperature_of_a_curve_is_there_twice():
    """Every 2.5 K from 29.7 degC, which binary numbers miss by rounding; and what is given between the steps."""
    found = curve_temperatures([29.7, 37.2, 42.2, 45.0], 37.0)
    np.testing.assert_allclose(found, [29.7, 32.2, 34.7, 37.0, 37.2, 39.7, 42.2, 44.7, 45.0], rtol=1e-14)
    np.testing.assert_array_equal(curve_temperatures([35.0, 40.0], 35.0), [35.0, 37.5, 40.0])


def test_levels_are_those_that_half_of_the_samples_reach():
    course = np.array([[37.0, 40.2], [37.0, 42.9], [37.0, 60.0], [np.nan, np.nan]])
    np.testing.assert_array_equal(levels_of(course, 37.0), np.arange(37.0, 43.0))


def test_rank_correlation_is_one_for_anything_that_rises():
    rng = np.random.default_rng(0)
    factors = rng.normal(1.0, 0.1, (40, 2))
    values = np.stack([np.exp(5.0 * factors[:, 0]), -(factors[:, 1] ** 3), np.ones(40)], axis=1)
    values[0, 0] = np.nan
    found = rank_correlations(factors, values)
    np.testing.assert_allclose([found[0, 0], found[1, 1]], [1.0, -1.0], atol=1e-12)
    assert abs(found[1, 0]) < 0.5 and np.all(np.isnan(found[:, 2]))


def test_highest_point_of_a_parabola():
    at = np.array([40.0, 45.0, 50.0, 55.0])
    assert highest_at(at, 3.0 - (at - 47.0) ** 2) == pytest.approx(47.0)
    assert highest_at(at, at) == 55.0 and highest_at(at, -at) == 40.0
    assert np.isnan(highest_at(at, np.full(4, np.nan)))


def analysed(displacement, sound):
    factors = np.concatenate([np.ones((1, 2)), draw_factors(SPREADS[:2], len(displacement) - 1, 0)])
    return analyse(np.array([35.0, 50.0]), displacement, 35.0, SPREADS[:2], factors, [1.0, 2.0], sound)


def test_samples_that_are_not_finite_are_counted_not_dropped():
    displacement = np.array([[2.0, 3.0], [2.0, 4.0], [np.nan, 4.0], [2.0, 8.0], [1.0, np.nan]])
    data = analysed(displacement, np.array([True, True, False, True, True]))
    assert data.sizes["sample"] == 5
    np.testing.assert_array_equal(data["usable"], [1, 1, 0, 1, 1])
    np.testing.assert_array_equal(data["n_reaching"], [3, 2])
    assert float(data["displacement_quantile"].sel(quantile=0.5)[1]) == pytest.approx(300.0)
    assert float(data["central_displacement_percent"][1]) == pytest.approx(150.0)
    with pytest.raises(InputError, match="only 1 of 4 samples"):
        analysed(displacement, np.array([True, True, False, False, False]))


def of_known_draws():
    """Five usable tissues beside the central one: displacement at 60 degC falls as the first constant rises."""
    first, second = np.array([1.0, 1.2, 0.8, 1.1, 0.9, 1.3, 1.0]), np.array([1.0, 0.9, 1.0, 1.3, 0.7, 1.1, 1.2])
    at = np.array([35.0, 40.0, 55.0, 60.0])
    hot = 200.0 - 100.0 * first + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.nan])
    percent = np.stack([np.full(7, 100.0), 98.0 + 2.0 * second, np.full(7, 120.0), hot], axis=1)
    displacement = 1e-8 * percent * (1.0 + np.arange(7.0))[:, None]
    sound = np.isfinite(displacement).all(axis=1)
    factors = np.stack([first, second], axis=1)
    return percent, analyse(at, displacement, 35.0, SPREADS[:2], factors, [3.0, 5.0], sound)


def test_what_is_said_of_known_draws():
    """Ranks, standard deviation and quantiles of the five, the central tissue and the sixth left out."""
    percent, data = of_known_draws()
    drawn = percent[1:6]
    np.testing.assert_allclose(data["displacement_percent"][:6], percent[:6], rtol=1e-12)
    np.testing.assert_allclose(data["displacement_sd"], drawn.std(axis=0, ddof=1), atol=1e-10)
    np.testing.assert_allclose(data["displacement_quantile"], np.quantile(drawn, QUANTILES, axis=0), rtol=1e-12)
    correlation = data["rank_correlation"].to_numpy()
    np.testing.assert_allclose([correlation[0, 3], correlation[1, 1]], [-1.0, 1.0], atol=1e-12)
    # Ranks of the first constant are 4 1 3 2 5, of the second 2 3 5 1 4: 1 - 6 sum d^2 / (5 24), d^2 of 4 4 4 1 1.
    np.testing.assert_allclose([correlation[0, 1], -correlation[1, 3]], 1.0 - 6.0 * 14.0 / 120.0, atol=1e-12)
    np.testing.assert_allclose(data["drawn_value"][2], [0.8 * 3.0, 1.0 * 5.0], rtol=1e-12)
    # The parabola through 40, 55 and 60 degC.
    curvature, slope = np.linalg.solve([[225.0, -15.0], [25.0, 5.0]], percent[1, [1, 3]] - 120.0)
    assert float(data["highest_at"][1]) == pytest.approx(55.0 - 0.5 * slope / curvature)
    np.testing.assert_allclose(correlation_noise(np.array([5, 101]), 1), [0.98, 0.196], rtol=1e-4)
    np.testing.assert_allclose(data["rank_correlation_by_chance"], correlation_noise(np.full(4, 5), 2), rtol=1e-12)


@pytest.mark.parametrize("reaching", [40, 160])
def test_chance_exceeds_its_bound_in_one_of_twenty(reaching):
    """The largest of seven constants that do nothing, in as many samples as reach a temperature."""
    rng = np.random.default_rng(1)
    (bound,) = correlation_noise(np.array([reaching]), 7)
    largest = [
        np.abs(rank_correlations(rng.random((reaching, 7)), rng.random((reaching, 1)))).max() for _ in range(1000)
    ]
    # Of 1000 draws of one in twenty, three standard deviations; Spearman's coefficient is normal to some percent.
    assert 0.05 - 0.021 < np.mean(np.array(largest) > bound) < 0.05 + 0.021


@pytest.mark.parametrize(
    ("temperature", "shown"),
    [
        ([37.0, 47.0, 57.0, 67.0, 77.0], [37.0, 47.0, 57.0, 67.0, 77.0]),
        ([37.0, 38.5, 39.5, 41.0, 42.5], [37.0, 39.5, 42.5]),
        ([36.6, 36.9], [36.6, 36.9]),
        (list(np.arange(35.0, 51.0)), [35.0, 40.0, 45.0, 50.0]),
    ],
)
def test_a_table_of_bands_has_rows_whatever_the_temperatures(temperature, shown):
    assert np.asarray(temperature)[variability_report._listed(np.asarray(temperature))].tolist() == shown


def test_what_a_table_of_bands_holds(tmp_path):
    """About every fifth degree and at both ends: how many, the median, the middle half and nine tenths, and what is
    followed most."""
    percent, data = of_known_draws()
    data = data.assign_coords(curve_temperature=[35.0, 42.5, 55.0, 60.0])
    low, lower, median, upper, high = np.quantile(percent[1:6, 3], [0.05, 0.25, 0.5, 0.75, 0.95])
    table = variability_report.rows(data)
    assert [row[0] for row in table] == ["35", "42.5", "55", "60"] and table[0][-1] == "-"
    bands = (f"{median:.1f}", f"{lower:.1f} to {upper:.1f}", f"{low:.1f} to {high:.1f}")
    assert table[-1] == ("60", "5", *bands, "attenuation of liver, at all temperatures (-1.00)")
    found = variability_report.results(data)
    assert (found["n_samples"], found["n_usable"], found["unusable_samples"]) == (6, 5, [6])
    assert found["displacement_quantiles"]["0.95"]["value"][-1] == pytest.approx(high)
    assert found["rank_correlation"]["liver_attenuation"][-1] == pytest.approx(-1.0)
    assert found["spreads"]["liver_attenuation_rise"]["central"] == {"value": 5.0, "unit": "Np/m"}
    shown = data["highest_at"].to_numpy()[1:6]
    stated = [found["temperature_of_highest_displacement"][name]["value"] for name in ("q05", "median", "q95")]
    np.testing.assert_allclose(stated, np.quantile(shown, [0.05, 0.5, 0.95]), rtol=1e-12)
    _write_tables(tmp_path, data)
    bands = list(csv.DictReader((tmp_path / "bands.csv").read_text().splitlines()))
    assert float(bands[-1]["quantile_25_percent"]) == pytest.approx(lower, rel=1e-7)
    assert float(bands[-1]["displacement_sd"]) == pytest.approx(percent[1:6, 3].std(ddof=1), rel=1e-7)
    assert float(bands[-1]["n_reaching"]) == 5.0 and float(bands[-1]["rank_correlation_liver_attenuation"]) == -1.0
    curves = list(csv.DictReader((tmp_path / "curves.csv").read_text().splitlines()))
    (one,) = (row for row in curves if row["sample"] == "2" and row["temperature_degc"] == "60.0")
    assert float(one["displacement_percent"]) == pytest.approx(120.0) and one["usable"] == "1"


def test_what_a_report_of_bands_warns_of():
    """Samples that are left out by number, boiling in drawn tissues alone, and who measured a spread."""
    _, data = of_known_draws()
    data = data.assign(boiling_time=("sample", np.array([3.0, np.nan, 7.0, np.nan, 9.0, np.nan, np.nan])))
    data.attrs |= {
        "title": "t", "protocol": "stepwise", "sampling": "Latin hypercube", "seed": 7, "temperature": "temperature",
    }  # fmt: skip
    text = variability_report.report(data, [], ["a note"])
    assert "in 6 tissues, drawn by Latin hypercube sampling with seed 7" in text and "- a note" in text
    assert "ONLY 5 of 6 samples are usable" in text and "samples 6." in text
    assert "Tissue reaches 100 degC in 2 samples" in text
    assert "| attenuation of liver, at all temperatures | 3 Np/m | 5.8 % | normal | measured |" in text
    whole = data.isel(sample=slice(6)).drop_vars("boiling_time")
    text = variability_report.report(whole, [], [])
    assert "- 5 of 5 samples are usable." in text and "100 degC" not in text
    assert "OWN CONSTANTS" not in text
    # The run of the model itself is no sample.
    data["usable"][0] = 0
    text = variability_report.report(data, [], [])
    assert "unknown with the model's own constants" in text and "THE RUN WITH THE MODEL'S OWN CONSTANTS" in text
    assert variability_report.results(data)["unusable_samples"] == [6]


def test_what_is_kept_of_a_watched_sonication_has_its_times():
    """With which displacement and temperatures can be drawn against time from the file."""
    time, course = np.array([0.0, 5.0, 10.0]), np.array([35.0, 50.0, 60.0])
    outcomes = {
        "tracked_displacement": 1e-8 * np.array([[1.0, 1.2, 1.1]] * 3), "heating_time": np.tile(time, (3, 1)),
        "thermocouple_temperature": np.tile(course, (3, 1)),
    }  # fmt: skip
    task = Task(MODEL, SETTINGS, lambda model: {}, None, 35.0, 35.0, "tracked_displacement", "thermocouple", 2, ())
    data = _dataset(task, np.ones((3, len(SPREADS))), outcomes)
    assert data["heating_time"].dims == ("output",) == data["tracked_displacement"].dims[1:]
    np.testing.assert_array_equal(data["heating_time"], time)
    assert data["heating_time"].attrs["units"] == "s"


def test_spreads_are_those_of_their_sources():
    """In percent of the mean, by the numbers that each source states; a modulus goes with the square of a speed."""
    stated = {
        "liver_attenuation": 100.0 * 0.03 / 0.52,
        "liver_attenuation_rise": 100.0 * 0.5 / 2.67,
        "liver_sound_speed": 100.0 * 11.0 / 1577.0,
        "liver_modulus": 100.0 * 0.4 / 1.8,
        "lesion_modulus": 50.0 * ((2.52 + 0.18) ** 2 - (2.52 - 0.18) ** 2) / 2.52**2,
        "liver_specific_heat": 3.0,
        "liver_conductivity": 5.0,
    }
    assert {each.name: pytest.approx(100.0 * each.relative_sd) for each in SPREADS} == stated
    # Three heats within three percent of their mean, and half of 9.6 percent.
    heats = np.array([3540.0, 3570.0, 3.567e6 / 1060.0])
    assert np.std(heats, ddof=1) / np.mean(heats) == pytest.approx(0.03, abs=2e-3)
    assert [each.name for each in SPREADS if not each.measured] == ["liver_specific_heat", "liver_conductivity"]


@pytest.mark.slow
def test_a_law_without_a_number_leaves_its_sample_without_one():
    """A NaN stays where it is: others of its chunk are as they were."""

    def broken(model, factor):
        law = Constant(jnp.where(factor > 1.0, jnp.nan, 1e4), unit="Pa", source="")
        solid = dataclasses.replace(model.lesion.viscoelasticity, branch_modulus=law)
        return dataclasses.replace(model, lesion=dataclasses.replace(model.lesion, viscoelasticity=solid))

    spread = dataclasses.replace(SPREADS[0], place=broken)
    found = outcomes_of(OUTCOME, MODEL, [spread], np.array([[0.9], [1.1], [0.9]]), chunk=3)["displacement"]
    np.testing.assert_array_equal(np.isfinite(found).all(axis=1), [True, False, True])
    np.testing.assert_array_equal(found[0], found[2])


def test_a_partial_file_is_read_by_the_same_run_alone(tmp_path):
    partial = PartialFile(tmp_path / "out", {"seed": 1})
    assert partial.load() == {}
    partial.keep({"displacement": np.arange(6.0).reshape(2, 3), "heating_power": np.arange(2.0)})
    found = PartialFile(tmp_path / "out", {"seed": 1}).load()
    np.testing.assert_array_equal(found["displacement"], np.arange(6.0).reshape(2, 3))
    np.testing.assert_array_equal(found["heating_power"], np.arange(2.0))
    with pytest.raises(InputError, match="other settings"):
        PartialFile(tmp_path / "out", {"seed": 2}).load()
    partial.path.write_bytes(b"half a file")
    with pytest.raises(InputError, match="cannot be read"):
        partial.load()
    partial.delete()
    assert list(tmp_path.iterdir()) == []


def test_nonsense_is_refused():
    with pytest.raises(InputError, match="2 or more"):
        draw_factors(SPREADS, 1, 0)
    with pytest.raises(InputError, match="no constant"):
        draw_factors([], 10, 0)
    for sd in (-0.1, 0.5, np.nan):
        with pytest.raises(InputError, match="relative_sd"):
            dataclasses.replace(SPREADS[0], relative_sd=sd)
    table = DESCRIBED.model_copy(update={"lesion": DESCRIBED.lesion.model_copy(update={"size": "table"})}).model()
    with pytest.raises(InputError, match="comes from a table"):
        transient_outcome(table, TransientProtocol(Sonication((Phase(30.0, 10),), 35.0), ShortPush()), SETTINGS)


@pytest.mark.parametrize(
    ("replacement", "options", "cause"),
    [
        ((), ["--samples", "1"], "'--samples'"),
        ((), ["--seed", "-1"], "'--seed'"),
        ((), ["--protocol", "stepped"], "'stepped' is not one of"),
        (('size = "dose"', 'size = "table"'), ["--protocol", "transient"], "comes from a table"),
        (
            ("normalised_at_c = 37.0", "normalised_at_c = 30.0"),
            ["--protocol", "transient"],
            "lies below",
        ),
        (("[transducer]", "[transducer"), [], "not valid TOML"),
    ],
)
def test_bad_command_lines(capfd, tmp_path, replacement, options, cause):
    text = EXPERIMENT.read_text(encoding="utf-8")
    for old, new in filter(None, [replacement]):
        assert old in text
        text = text.replace(old, new)
    file = tmp_path / "e.toml"
    file.write_text(text, encoding="utf-8")
    assert run(["vary", str(file), "--out", str(tmp_path / "out"), *options]) == 2
    error = capfd.readouterr().err
    assert error.startswith("arfjax: ") and error.count("\n") == 1 and cause in error
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_command_goes_on_where_it_was_stopped(capfd, tmp_path, monkeypatch):
    """Stopped after its first chunk and begun again, it writes what one run does, and takes its partial file away."""
    arguments = ["vary", str(EXPERIMENT), "--samples", "24", "--seed", "4"]
    kept = PartialFile.keep

    def stopped(self, outcomes):
        kept(self, outcomes)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(PartialFile, "keep", stopped)
        assert run([*arguments, "--out", str(tmp_path / "halves")]) == 130
    assert "20 runs are kept" in capfd.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["halves.partial.nc"]
    assert run([*arguments[:-1], "5", "--out", str(tmp_path / "halves")]) == 2
    assert "other settings" in capfd.readouterr().err
    for out in ("halves", "whole"):
        assert run([*arguments, "--out", str(tmp_path / out)]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["halves", "whole"]
    halves, whole = ((tmp_path / out / "curves.csv").read_text() for out in ("halves", "whole"))
    assert halves == whole
    summary = json.loads((tmp_path / "whole" / "summary.json").read_text())
    results = summary["results"]
    assert summary["seed"] == 4 and results["n_usable"] == 24 and results["unusable_samples"] == []
    assert results["displacement_quantiles"]["0.5"]["value"][0] == pytest.approx(100.0)
    with xr.open_dataset(tmp_path / "whole" / "variability.nc", engine="h5netcdf") as data:
        assert data.sizes["sample"] == 25 and np.all(data["factor"][0] == 1.0)
        np.testing.assert_allclose(data["drawn_value"], data["factor"] * data["central_value"])
        assert data["displacement"].attrs["units"] == "m"
        # At 70 degC all is lesion: softer ones move more.
        assert float(data["rank_correlation"].sel(constant="lesion_modulus")[-1]) < -0.3
    with (tmp_path / "whole" / "bands.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert float(rows[0]["temperature_degc"]) == 35.0 and float(rows[-1]["temperature_degc"]) == 70.0
    for name in ("bands", "sensitivity"):
        assert (tmp_path / "whole" / f"{name}.png").stat().st_size > 10_000
    assert "assumed" in (tmp_path / "whole" / "report.md").read_text()
