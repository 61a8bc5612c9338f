"""Records of posteriors: what is in them, with which units, and that files give back what went in."""

import dataclasses
import importlib.metadata

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import InputError
from inverse.datasets.dma import group_sweeps, read_dma
from inverse.datasets.shipped import shipped
from inverse.figures import dma_panels, draw_corner, draw_overlap, draw_predictions, draw_traces
from inverse.inference.dma import dma_problem
from inverse.sampling import Draws, left_out, load_posterior, posterior_record, save_posterior
from inverse.sampling.inference_data import groups_of
from inverse.sampling.overlap import record_columns
from inverse.sampling.target import batched_log_density, batched_values, prior_points


@pytest.fixture(scope="module")
def sweeps():
    return group_sweeps(read_dma(shipped("pyvisco_polymer")))[15:17]


@pytest.fixture(scope="module")
def problem(sweeps):
    return dma_problem(sweeps, across="temperature")


@pytest.fixture(scope="module")
def draws(problem):
    size = problem.parameters.size
    u = np.asarray(problem.start) + 0.1 * np.random.default_rng(0).normal(size=(2, 60, size))
    density = batched_log_density(problem)(u.reshape(-1, size)).reshape(2, 60)
    statistics = {"diverging": np.zeros((2, 60), dtype=bool), "acceptance_rate": np.full((2, 60), 0.8)}
    return Draws(u, density, statistics, "test 1.0", 7, {"warmup": 10}, True, "as asked", 120, 1.5)


@pytest.fixture(scope="module")
def record(problem, draws):
    return posterior_record(problem, draws, predictive=40, prior=200, attributes={"sample": "polymer"})


def test_values_have_names_units_and_coordinates(problem, draws, record):
    posterior = record["posterior"]
    assert posterior["relaxed_modulus"].dims == ("chain", "draw", "temperature")
    assert list(posterior["temperature"].to_numpy()) == list(problem.parameters.entries[0].groups)
    assert posterior["relaxed_modulus"].attrs == {
        "units": "Pa",
        "long_name": problem.parameters.entries[0].parameter.title,
    }
    assert posterior["relaxed_modulus_population"].attrs["units"] == "Pa"
    assert posterior["relaxed_modulus_spread"].dims == ("chain", "draw")
    values = np.asarray(problem.values(jnp.asarray(draws.unconstrained[1, 5])))
    names = list(problem.parameters.names)
    np.testing.assert_allclose(posterior["relaxed_modulus"][1, 5], values[2:4], rtol=1e-12)
    np.testing.assert_allclose(posterior["noise"][1, 5], values[names.index("noise")], rtol=1e-12)
    np.testing.assert_array_equal(record["unconstrained_posterior"]["unconstrained"], draws.unconstrained)
    np.testing.assert_array_equal(record["sample_stats"]["lp"], draws.log_density)
    assert record["prior"]["relaxed_modulus"].shape == (1, 200, 2)


def test_columns_of_a_record_are_its_values_one_by_one(problem, draws, record):
    """Groups by their names, each with its own draws of the prior."""
    columns = record_columns(record)
    assert {one.name for one in columns} == set(problem.parameters.names)
    values, groups = batched_values(problem, draws.flat), list(record["posterior"]["temperature"].to_numpy())
    for one in columns:
        place = problem.parameters.names.index(one.name)
        np.testing.assert_allclose(one.posterior.ravel(), values[:, place], rtol=1e-12)
        assert one.unit == problem.parameters.columns[place][1]
        variable, _, group = one.name.partition("[")
        believed = record["prior"][variable]
        expected = believed[0] if not group else believed[0, :, groups.index(group.rstrip("]"))]
        np.testing.assert_array_equal(one.prior, expected)


def test_pointwise_terms_add_up_to_the_likelihood(problem, draws, record):
    total = record["log_likelihood"]["dma"].sum("dma_datum").to_numpy()
    for chain, draw in ((0, 0), (1, 17)):
        exact = float(problem.log_likelihood(jnp.asarray(draws.unconstrained[chain, draw])))
        np.testing.assert_allclose(total[chain, draw], exact, rtol=1e-10)


def test_predictions_scatter_as_the_noise_says(problem, draws, record):
    predictive = record["posterior_predictive"]
    assert predictive["dma"].shape == (1, 40, len(problem.measurements[0].measured))
    u = draws.spread_evenly(40)[11]
    exact = problem.measurements[0].predict(problem.state_of(problem.values(jnp.asarray(u))).model)
    np.testing.assert_allclose(predictive["dma_mean"][0, 11], exact, rtol=1e-9)
    scatter = (predictive["dma"] - predictive["dma_mean"]).to_numpy()
    noise = np.mean(record["posterior"]["noise"].to_numpy() ** 2) ** 0.5
    np.testing.assert_allclose(scatter.std(), noise, rtol=0.15)
    np.testing.assert_array_equal(record["observed_data"]["dma"], problem.measurements[0].measured)
    np.testing.assert_array_equal(record["observed_data"]["dma_coordinate"], problem.measurements[0].series.coordinate)


def test_draws_of_the_prior_without_a_prediction_are_left_out_and_counted(problem, draws, record, tmp_path):
    """A model that covers half of the prior: the other half is counted, in the record, its file and a sentence."""
    (measurement,) = problem.measurements
    limit = float(np.median(record["prior"]["fractional_order_population"]))

    def covered(model):
        return jnp.where(model.solids[0].fractional_order < limit, measurement.predict(model), jnp.nan)

    half = dataclasses.replace(problem, measurements=(dataclasses.replace(measurement, predict=covered),))
    found = posterior_record(half, draws, predictive=60, prior=200, pointwise=False)
    save_posterior(found, tmp_path / "posterior.nc")
    for each in (found, load_posterior(tmp_path / "posterior.nc")):
        predicted = each["prior_predictive"]
        kept = each["prior"]["fractional_order"].isel(chain=0, temperature=0).to_numpy()[:60] < limit
        assert 10 < np.sum(kept) < 50
        np.testing.assert_array_equal(predicted["draw"], np.flatnonzero(kept))
        assert np.all(np.isfinite(predicted["dma"])) and predicted["dma"].sizes["draw"] == np.sum(kept)
        assert predicted.attrs["draws_asked"] == 60 and predicted.attrs["draws_left_out"] == 60 - np.sum(kept)
    assert f"Of 60 draws of the prior, {60 - np.sum(kept)} lie where the model predicts nothing" in left_out(found)
    assert left_out(record) == ""


def test_files_give_back_what_went_in(record, tmp_path):
    path = tmp_path / "posterior.nc"
    save_posterior(record, path)
    back = load_posterior(path)
    assert type(back) is type(record)
    before, after = groups_of(record), groups_of(back)
    assert set(before) == set(after)
    for name, group in before.items():
        assert group.identical(after[name]), name
    assert dict(back.attrs) == dict(record.attrs)
    assert back.attrs["sampler"] == "test 1.0" and back.attrs["seed"] == 7 and back.attrs["sample"] == "polymer"
    assert back.attrs["stopping_reason"] == "as asked" and back.attrs["stopping_rule_met"] == 1
    assert back.attrs["evaluations"] == 120 and back.attrs["seconds"] == 1.5 and back.attrs["sampler_warmup"] == 10
    assert back.attrs["jax_version"] == importlib.metadata.version("jax")
    assert [file.name for file in tmp_path.iterdir()] == ["posterior.nc"]


def test_files_of_something_else_are_refused(tmp_path):
    (tmp_path / "no.nc").write_text("not NetCDF")
    with pytest.raises(InputError, match="is no NetCDF file of a posterior"):
        load_posterior(tmp_path / "no.nc")


def test_ensembles_are_thinned_and_say_so(problem, draws):
    many = np.tile(draws.unconstrained, (1, 200, 1)), np.tile(draws.log_density, (1, 200))
    walkers = Draws(*many, {}, "test", 0, {}, True, "", 0, 1.0, True)
    record = posterior_record(problem, walkers, predictive=2, prior=2, pointwise=False)
    assert record.attrs["sampler_thinned_by"] == 2 and record["posterior"].sizes["draw"] == 6000
    assert "log_likelihood" not in groups_of(record)


def test_figures_are_drawn(record, sweeps, tmp_path):
    figures = {
        "corner": draw_corner(record, ["noise", "relaxed_modulus_population", f"relaxed_modulus[{sweeps[0].label}]"]),
        "overlap": draw_overlap(record),
        "traces": draw_traces(record),
        "predictions": draw_predictions(record, "dma", dma_panels(sweeps)),
    }
    for name, figure in figures.items():
        figure.savefig(tmp_path / f"{name}.png")
    assert len(figures["corner"].axes) == 6 and len(figures["predictions"].axes) == 8
    assert len(figures["overlap"].axes) == len(figures["traces"].axes) // 2
    shown = figures["predictions"].axes[0].lines[1].get_ydata()
    assert 1.0 <= np.max(shown) < 1000.0


def test_draws_of_the_prior_follow_it(problem):
    points = prior_points(problem, jax.random.key(0), 4000)
    middle = np.quantile(np.asarray(jax.vmap(problem.values)(jnp.asarray(points)))[:, 0], 0.5)
    assert middle == pytest.approx(problem.parameters.entries[0].parameter.prior.median, rel=0.25)
