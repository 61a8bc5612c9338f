"""The benchmarks run: what they measure is for idle machines, not for tests."""

import json
import sys

import numpy as np
import pytest
from scipy import stats

from benchmarks import (
    acoustics,
    diagnosis,
    diagnosis_again,
    diagnosis_hmi,
    diagnosis_hmi_fast,
    diagnosis_pages,
    inference,
    mechanics,
    protocols,
    real_data,
)
from benchmarks.diagnosis_docs import write_docs
from benchmarks.diagnosis_limits import Design, limits, projected_length
from benchmarks.diagnosis_pages import compared
from benchmarks.diagnosis_record import ROOT, arguments, code_in, code_of, recorded, stamp, stamp_on
from benchmarks.diagnosis_rests import linear_rests, removed_limits
from benchmarks.diagnosis_studies import DMA_STUDY, HMI_STUDY, Bound
from benchmarks.diagnosis_summary import NO_DATA, rate, summarise
from inverse.diagnosis import HMI_CAUSES
from inverse.diagnosis.noise import noise_family, series
from inverse.diagnosis.screening import Alternative
from tests.blind.no_such_effect import NoSuchEffect


@pytest.mark.slow
def test_benchmark_of_the_sound_field_runs(tmp_path, monkeypatch):
    out = tmp_path / "acoustics.json"
    monkeypatch.setattr(sys, "argv", ["acoustics", "--quick", "--out", str(out)])
    acoustics.main()
    found = json.loads(out.read_text())
    case = found["five layers, 50 W"]["float32"]
    assert set(case["errors"]["T3"]) == {*acoustics.LIMITS, "within"}
    assert case["forward"]["min_s"] > 0.0 and case["forward"]["temp_mb"] > 0.0
    assert case["gradient, 1 steps per checkpoint"]["over_forward"] > 0.0
    assert found["growth, float32"]["harmonics"]["sizes"] == list(acoustics.QUICK.harmonics)
    assert found["attenuations at once, float32"][0]["members"] == 2
    assert found["paper's run"]["float32"]["repeats"] == 1


@pytest.mark.slow
def test_benchmark_of_mechanics_runs(tmp_path, monkeypatch):
    out = tmp_path / "mechanics.json"
    monkeypatch.setattr(sys, "argv", ["mechanics", "--quick", "--out", str(out)])
    mechanics.main()
    found = json.loads(out.read_text())
    assert set(found["push of 0.5 ms"]) == set(found["explicit push of 0.5 ms"]) | {"fzener"}
    assert found["50 Hz"]["error"] < 3e-4 and found["explicit push of 0.5 ms"]["zener"]["error_extrapolated"] < 1e-2
    assert found["large"]["run"]["min_s"] > 0.0 and found["growth at 20 steps"]["unknowns"][0] > 0


@pytest.mark.slow
def test_benchmark_of_the_protocols_runs(tmp_path, monkeypatch):
    out = tmp_path / "protocols.json"
    monkeypatch.setattr(sys, "argv", ["protocols", "--quick", "--out", str(out)])
    protocols.main()
    found = json.loads(out.read_text())["cases"]
    assert list(found) == ["stepwise, fast"]
    times = found["stepwise, fast"]
    assert times["gradient over run"] == pytest.approx(
        times["value and gradient"]["median_s"] / times["run"]["median_s"], abs=0.01
    )


@pytest.mark.parametrize("name", ["T1_P50", "T2_P50", "T3_P50", "T1_P150", "T2_P150", "T3_P150"])
def test_positions_are_stored_ones_a_step_apart(name):
    stored = np.load(acoustics.REFERENCE / f"{name}.npz")["z_m"]
    step = acoustics.SETTINGS[int(name[4:])].axial_step
    z = acoustics.positions(stored, step)
    assert set(z) <= set(stored)
    assert 0.9 * step < np.diff(z).max() <= step
    assert z[0] < acoustics.FOCUS[0] and z[-1] > acoustics.FOCUS[1]


@pytest.mark.slow
def test_benchmark_of_the_fast_model_runs(tmp_path, monkeypatch):
    out = tmp_path / "inference.json"
    monkeypatch.setattr(sys, "argv", ["inference", "--quick", "--out", str(out)])
    inference.main()
    found = json.loads(out.read_text())
    assert found["cases"]["single"]["median_s"] > 0.0 and found["cases"]["4 walkers"]["per_walker_s"] > 0.0
    assert found["errors"]["covered"] == 1.0 and found["errors"]["largest"] < 0.03


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("model", ["fractional", "zener"])
def test_benchmark_of_the_diagnosis_goes_on_where_it_stopped(tmp_path, monkeypatch, model):
    out = tmp_path / "diagnosis.jsonl"
    given = ["diagnosis", "--out", str(out), "--docs", str(tmp_path / "docs"), "--only", "null", "--development"]
    given += ["--model", model]
    monkeypatch.setattr(diagnosis, "NOISES", ("white",))
    monkeypatch.setattr(diagnosis, "NOISES_IN_TIME", ())
    monkeypatch.setattr(diagnosis, "NULL_SETS", 1)
    for count in (1, 2):
        monkeypatch.setattr(sys, "argv", [*given, "--sets", str(count)])
        diagnosis.main()
        lines = [json.loads(row) for row in out.read_text().splitlines()]
        # One in white noise, and one in which magnitude and phase are unequally loud.
        assert len(lines) == len({line["seed"] for line in lines}) == 2 * count
        assert {line["model"] for line in lines} == {model}
    found = json.loads(out.with_suffix(".json").read_text())
    assert {noise: one["alarm"]["sets"] for noise, one in found["null"].items()} == {"white": 2, "unequal": 2}
    assert found["seeds"] == "development"
    study = diagnosis.STUDIES[model]
    assert (tmp_path / "docs" / study.picture).exists()
    assert study.title in (tmp_path / "docs" / study.page).read_text()


def test_seeds_of_development_and_test_are_disjoint_and_no_two_sets_share_one():
    for study, rounds in ((diagnosis, (12, 25)), (diagnosis_hmi, (20, 25))):
        for development, sets in zip((True, False), rounds, strict=True):
            todo = study.planned(sets, development)
            seeds = {seed for _, seed in todo}
            assert len(seeds) == len(todo) > 800
            assert (max(seeds) < study.blind.TEST_SEEDS) == development


def test_seeds_of_either_model_are_apart():
    test, development = ({m: diagnosis.planned(12, d, m) for m in diagnosis.STUDIES} for d in (False, True))
    seeds = {model: {seed for _, seed in todo} for model, todo in test.items()}
    assert seeds["fractional"].isdisjoint(seeds["zener"])
    assert max(seed for _, seed in development["zener"]) < diagnosis.blind.TEST_SEEDS <= min(seeds["zener"])
    found = [{one.name for one, _ in todo} for todo in test.values()]
    assert found[1] - found[0] == {"power-law-relaxation"} and {one.model for one, _ in test["zener"]} == {"zener"}


def test_noise_correlated_in_time_is_hardly_so_along_frequency_where_that_is_another_order():
    rng = np.random.default_rng(3)
    alike = {"time": [], "frequency": []}
    for _ in range(300):
        m = diagnosis.blind.draw_measurement(rng, shuffled=True)
        along = diagnosis.blind.draw_noise("correlated-in-time-0.6", m, rng).real
        in_time = np.take_along_axis(along, np.argsort(m.clock, axis=1), axis=1)
        for name, one in (("time", in_time), ("frequency", along)):
            alike[name].append(np.mean(one[:, 1:] * one[:, :-1]))
    # 300 sets of 65 pairs: a standard error of 0.01. Of neighbours in frequency one in seven is one in time, too.
    assert np.mean(alike["time"]) == pytest.approx(0.6, abs=0.03)
    expected = sum(2.0 * (14 - lag) * 0.6**lag for lag in range(1, 14)) / (14 * 13)
    assert np.mean(alike["frequency"]) == pytest.approx(expected, abs=0.03)
    planned = {one.noise for one, _ in diagnosis.planned(1, False)}
    assert {"correlated-in-time-0.3", "correlated-in-time-0.6"} <= planned


def test_rates_of_two_models_are_not_mixed(tmp_path, monkeypatch):
    (tmp_path / "old.jsonl").write_text('{"part": "null", "seed": 5, "stamp": "any"}\n')
    monkeypatch.setattr(sys, "argv", ["diagnosis", "--out", str(tmp_path / "old.jsonl"), "--model", "zener"])
    with pytest.raises(SystemExit, match=r"old.jsonl: has data sets of the model fractional, not zener"):
        diagnosis.main()


def test_an_effect_of_which_no_strength_is_so_large_is_no_data():
    """Beside a relaxation of nearly the same time a second one is imitated, the better the stronger it is."""
    line = diagnosis.one_set(diagnosis.Condition("removed", "second-relaxation", 9.0, "white", 1, "zener"), 2_075_002)
    assert line["verdict"] == NO_DATA and line["seed"] == 2_075_002 and line["model"] == "zener"
    assert line["why"] == "no strength of second-relaxation leaves d' = 9"


def test_records_of_other_code_are_not_added_to_but_summed_up_and_said_to_be(tmp_path):
    (tmp_path / "new.txt").write_text("new")
    given = arguments("", out="any.jsonl", sets=1).parse_args(["--out", str(tmp_path / "some.jsonl")])
    todo = [(diagnosis.Condition("null", "none", 0.0, "white", 1), 5)]
    made = recorded(lambda condition, seed: {"part": condition.part, "seed": seed}, todo, given, "this")
    assert made == [{"part": "null", "seed": 5, "stamp": "this"}]
    assert recorded(lambda *_: pytest.fail("it was done"), todo, given, "this") == made
    with pytest.raises(SystemExit, match=r"some.jsonl: has lines that other code than this \(that\) made"):
        recorded(lambda *_: {}, todo, given, "that")
    given.minutes = 0.0
    assert recorded(lambda *_: pytest.fail("only summed up"), todo, given, "that") == made
    assert code_of(made, "that").startswith("Seeds from 5 to 5. Judged by code of the stamp this: ")
    assert stamp_on(f"A page. {code_of(made, 'that')}") == "this" and stamp_on("Another.") == ""
    given.out.write_text(given.out.read_text() + '{"part": "null", "seed": 6, "stamp": "another"}\n')
    with pytest.raises(SystemExit, match="if it is all of one code"):
        recorded(lambda *_: {}, todo, given, "that")
    given.anew, before = True, given.out.read_text()
    with pytest.raises(SystemExit, match="if it is all of one code"):
        recorded(lambda *_: {}, todo, given, "that")
    assert given.out.read_text() == before  # nothing is dropped where nothing is made
    given.minutes = 1.0
    again = recorded(lambda condition, seed: {"part": condition.part, "seed": seed}, todo, given, "that")
    assert again == [{"part": "null", "seed": 5, "stamp": "that"}]
    assert [json.loads(row) for row in given.out.read_text().splitlines()] == again
    assert recorded(lambda *_: pytest.fail("it is of this code"), todo, given, "that") == again
    assert stamp(["tests/test_benchmarks.py"]) != stamp(["tests/test_benchmarks.py", "benchmarks/spread.py"])


def test_a_record_depends_on_code_and_not_on_what_is_said_about_it():
    with_words = '"""A module."""\nx = "#1"  # one\n\n\ndef f():\n    """Twice\n    x."""\n    return x\n'
    assert code_in(with_words) == 'x = "#1"\ndef f():\n    return x' == code_in(code_in(with_words))
    assert code_in(with_words.replace("#1", "#2")) != code_in(with_words)
    cause = 'class Some:\n    name = "some"\n    source = (\n  "Some"\n  "body"\n    )\n    helps = "More."\n'
    assert code_in(cause) == 'class Some:\n    name = "some"' and code_in('helps = f("x")') == 'helps = f("x")'
    assert stamp(["inverse/diagnosis/report.py"]) == stamp([]) != stamp(["inverse/diagnosis/decision.py"])


def test_every_page_of_rates_says_which_code_it_is_of():
    pages = {page.name for page in (ROOT / "docs").glob("operating_characteristic*.md")}
    found = compared()
    assert found.keys() == pages
    assert all(len(made_by) == len(here) == 12 for made_by, here in found.values())
    assert (
        diagnosis_pages.said("a", "a") == "as the code here" and diagnosis_pages.said("a", "b") == "changed since, to b"
    )
    for old, newer in diagnosis_pages.ALIKE.items():
        assert [diagnosis_pages.said(old, new).split(", ")[1:] for new in newer] == [
            [f"to {new}", f"which answered {same} of {count} data sets alike"] for new, (same, count) in newer.items()
        ]


def test_code_that_changed_twice_answers_as_many_sets_alike_as_the_fewest(monkeypatch):
    monkeypatch.setattr(diagnosis_pages, "ALIKE", {"a": {"b": (800, 800), "d": (4, 5)}, "b": {"c": (299, 300)}})
    assert [diagnosis_pages.alike("a", here) for here in "bcde"] == [(800, 800), (299, 300), (4, 5), (0, 0)]
    assert diagnosis_pages.said("a", "c") == "changed since, to c, which answered 299 of 300 data sets alike"


def test_seeds_of_a_condition_do_not_run_into_those_of_the_next():
    with pytest.raises(SystemExit, match="ask for fewer"):
        diagnosis.planned(25, True)


def test_nothing_is_met_by_so_few_sets_that_none_may_fail():
    assert [Bound(lower=99.0).sets, Bound(upper=5.0).sets, Bound(92.0, 98.0).sets] == [100, 20, 50]
    assert Bound(92.0, 98.0).met(95.0) and not Bound(92.0, 98.0).met(99.0) and not Bound(upper=5.0).met(5.1)


def test_page_of_the_diagnosis_says_what_was_asked_and_what_was_measured(tmp_path):
    always = {"p": 0.01, "first": "slip", "misfits": {}, "covered": True, "seconds": 1.0, "noise": "white"}
    one = always | {"name": "slip", "verdict": "named", "named": ["slip"], "confusable": [], "possible": ["slip"]}
    other = one | {"verdict": "unexplained", "named": [], "possible": [], "covered": False}
    lines = [
        *({"part": "known", "d_prime": d} | line for d in (4.5, 6.0) for line in 5 * (one, one, one, other)),
        *({"part": "null", "d_prime": 0.0} | line for line in (one, *[one | {"verdict": "adequate"}] * 3)),
        *({"part": part, "d_prime": d} | other for part in ("unknown", "removed") for d in (5.0, 9.0)),
        *({"part": "unequal", "d_prime": 4.5} | line for line in (one, one, other, other)),
    ]
    of_slip = {"detected": 0.97, "first": 0.8, "detected, noise unknown": 0.94, "first, noise unknown": 0.79}
    limit = {f"{d:g}": {"slip": of_slip} for d in (4.5, 6.0)}
    left = {"stand-in": "sweep-drift", "left": 4.0, "noise known": 0.99, "noise unknown": 0.9}
    rests = {"slip": left, "drying": {"why": "no strength of it shows"}}
    summary = {"seeds": "test", **summarise(lines, limit, {"9": rests}, in_unequal=limit)}
    assert summary["unequal"]["all known"]["4.5"]["in the set, if detected"]["rate"] == 0.5
    assert summary["all known"]["4.5"]["unexplained, if detected"]["rate"] == 0.25
    assert summary["null"]["white"]["alarm"]["rate"] == 0.25 and summary["null"]["white"]["noise-model"]["rate"] == 0.0
    write_docs(summary, tmp_path, DMA_STUDY)
    page = (tmp_path / DMA_STUDY.page).read_text()
    assert (
        "| d' = 4.5: detected, at least 93, or 3 below the limit | 100.0" in page
        and "| 97.0 | 94.0 | 20 | yes |" in page
    )
    assert "of those detected, unexplained, at most 5 | 25.0" in page and "| 20 | no |" in page
    assert "## Known causes, d' = 4.5, magnitude and phase of unequal noise" in page
    # Of one data set, nothing is met or not.
    assert "wrongly named, at most 5 | 0 of 1 |  |  | 1 | too few |" in page
    assert "| 9 | slip | sweep-drift | 4.0 | 99 | 90 |" in page
    assert "above 1 in place of all causes or 3 beside the one that fits best" in page
    assert "| 9 | drying | no strength of it shows | – | – | – |" in page
    assert "at least 90 of 100, the noise unknown: d' = 9: unexplained 1 of 1, named 0 of 1" in page
    others = {"slip": left | {"noise unknown": 0.89}, "drying": left}
    assert summarise(lines, limit, {"9": others})["removed, to be seen"] == {}
    assert (tmp_path / DMA_STUDY.picture).stat().st_size > 10_000


def test_page_of_displacement_needs_no_limit_of_removed_causes(tmp_path):
    one = {"first": "perfusion", "named": [], "confusable": [], "possible": [], "seconds": 1.0, "noise": "white"}
    # That the noise is another than one thought is no effect detected.
    one |= {"name": "perfusion", "verdict": "noise-model"}
    lines = [
        *({"part": "known", "d_prime": d} | one for d in (4.5, 6.0)),
        {"part": "null", "d_prime": 0.0} | one,
        *({"part": part, "d_prime": 9.0} | one for part in ("unknown", "removed")),
    ]
    limit = {f"{d:g}": {"perfusion": {"detected": 0.97, "first": 0.8}} for d in (4.5, 6.0)}
    write_docs({"seeds": "test", **summarise(lines, limit)}, tmp_path, HMI_STUDY)
    page = (tmp_path / HMI_STUDY.page).read_text()
    assert "displacement" in page and "| d' = 4.5: detected, at least 93, or 3 below the limit | 0 of 1 |" in page
    assert "above 1 in place of all causes or 3 beside the one that fits best" in page
    assert "| 9 | perfusion | 0 of 1 | 0 of 1 | 0 of 1 | 1 of 1 | 1 |" in page
    assert (tmp_path / HMI_STUDY.picture).stat().st_size > 10_000


def test_what_is_met_or_missed_by_less_than_the_error_is_said_to_be(tmp_path):
    found = {
        "first": "slip",
        "named": ["slip"],
        "confusable": [],
        "possible": ["slip"],
        "seconds": 1.0,
        "covered": True,
    }
    found |= {"name": "slip", "verdict": "named", "part": "known", "noise": "white"}
    missed = found | {"verdict": "adequate", "named": [], "possible": [], "first": "drying"}
    lines = [one | {"d_prime": d} for d in (4.5, 6.0) for one in [*[found] * 18, *[missed] * 2]]
    limit = {f"{d:g}": {"slip": {"detected": 0.99, "first": 0.85}} for d in (4.5, 6.0)}
    write_docs({"seeds": "test", **summarise(lines, limit)}, tmp_path, DMA_STUDY)
    page = (tmp_path / DMA_STUDY.page).read_text()
    # 90 +- 7 of 20: 93 is less than an error above, 82 is more than one below.
    assert "at least 93, or 3 below the limit | 90.0 ± 6.8 | 99.0 |  | 20 | no, within its error |" in page
    assert "at least 92, or 3 below the limit | 90.0 ± 6.8 | 85.0 |  | 20 | yes |" in page


def linear_design() -> Design:
    """Two causes, along temperature and, of either sign, along time; one constant and a factor of each sonication."""
    sonication = np.repeat(np.arange(3), [14, 19, 24])
    temperature = 37.0 + 2.0 * np.concatenate([np.arange(n) for n in (14, 19, 24)])
    directions = {"perfusion": np.sin(temperature / 6.0), "output-drift": np.cos(temperature / 4.0 + sonication)}
    believed = np.array([0.01])
    constants = np.append(temperature - 50.0, believed)[:, None]
    factors = np.append(np.eye(3)[sonication], np.zeros((1, 3)), axis=0)
    effects = {name: np.append(one, 0.0)[:, None] for name, one in directions.items()}
    fitted = np.append(constants, factors, axis=1)
    family = noise_family((series("time", sonication.tolist(), temperature),), temperature)
    return Design(
        fitted=fitted,
        alternatives=[
            *(Alternative(name, effect, 1) for name, effect in effects.items()),
            Alternative("output-drift", effects["output-drift"], -1),
        ],
        truths={
            name: {sign: sign * effect / projected_length(effect[:-1], fitted[:-1]) for sign in (1, -1)}
            for name, effect in effects.items()
        },
        family=[one.extended(1) for one in family],
        free_forms=[Alternative("at-61", np.append(temperature == 61.0, 0.0)[:, None])],
        temperature=temperature,
    )


@pytest.mark.parametrize(
    ("part", "name"),
    [("known", "perfusion"), ("known", "output-drift"), ("null", "none"), ("removed", "perfusion")],
)
def test_linear_sets_find_an_effect_and_spare_noise(part, name):
    condition = diagnosis_hmi.Condition(part, name, 0.0 if part == "null" else 15.0)
    lines = diagnosis_hmi_fast.some_sets([linear_design()], condition, range(10))
    found = [line for line in lines if line["verdict"] != "adequate"]
    if part == "null":
        assert len(found) <= 3  # more have a probability of 0.1 %, and the seeds are the first that were taken
        return
    if part == "known":
        assert len(found) == len(lines) and all(line["first"] == name for line in lines)
    else:
        assert all(name not in [line["first"], *line["possible"]] for line in lines)
        assert all(line["verdict"] in ("adequate", "unexplained") for line in lines)


def test_effects_hidden_with_either_sign_are_looked_for_with_either():
    either = {cause.name for cause in HMI_CAUSES if cause.sign == 0}
    assert set(diagnosis_hmi.blind.BOTH_WAYS) <= either


def test_constants_near_their_middle_change_what_is_believed_of_them_and_no_reading():
    near, believed = (
        diagnosis_hmi_fast._drawn(
            linear_design(), diagnosis_hmi.Condition("null", "none", 0.0, noise), 5, np.random.default_rng(5)
        )
        for noise in ("loud" + diagnosis_hmi_fast.NEAR, "loud")
    )
    np.testing.assert_array_equal(near[:-1], believed[:-1])
    assert near[-1] == pytest.approx(0.6 * believed[-1])
    planned = [condition.noise for condition, _ in diagnosis_hmi_fast.planned(1.0, False) if condition.part == "null"]
    noises = (*diagnosis_hmi.NOISES, "understated")
    assert set(planned) == {*noises, *(noise + "-near" for noise in noises)}


def test_noise_that_is_understated_is_larger_than_beliefs_are_weighed_by():
    understated, white = (
        diagnosis_hmi_fast._drawn(
            linear_design(), diagnosis_hmi.Condition("null", "none", 0.0, noise), 5, np.random.default_rng(5)
        )
        for noise in ("understated", "white")
    )
    np.testing.assert_allclose(understated[:-1], 1.3 * white[:-1], rtol=1e-15)
    assert understated[-1] == white[-1]


@pytest.mark.parametrize(("looked_for", "least", "most"), [(True, 0.6, 1.4), (False, 1.8, 5.0)])
def test_beliefs_of_linear_sets_weigh_against_the_noise_that_is_found(looked_for, least, most):
    """Beside an effect of d' 15 that is looked for; one that is not in the library counts as noise."""
    about, condition = linear_design(), diagnosis_hmi.Condition("known", "output-drift", 15.0)
    data = diagnosis_hmi_fast._drawn(about, condition, 5, np.random.default_rng(5))
    causes = [one for one in about.alternatives if looked_for or one.name != "output-drift"]
    weighed, fitted = diagnosis_hmi_fast._weighed(data, about.fitted, about.family, causes)
    np.testing.assert_array_equal(weighed[:-1], data[:-1])
    np.testing.assert_array_equal(fitted[:-1], about.fitted[:-1])
    factor = weighed[-1] / data[-1]
    assert least < factor < most and fitted[-1] == pytest.approx(factor * about.fitted[-1])


def test_effects_without_a_name_are_weak_and_strong():
    planned = {(one.part, one.d_prime) for one, _ in diagnosis_hmi_fast.planned(1.0, False)}
    assert {(part, d) for part in ("unknown", "removed") for d in (5.0, 9.0)} <= planned


def test_linear_sets_are_planned_with_seeds_of_their_own():
    for development in (True, False):
        seeds = [seed for _, some in diagnosis_hmi_fast.planned(1.0, development) for seed in some]
        assert len(seeds) == len(set(seeds)) > 2000
        assert {seed < diagnosis_hmi.blind.TEST_SEEDS for seed in seeds} == {development}
    with pytest.raises(ValueError, match="share"):
        diagnosis_hmi_fast.planned(1.5, True)


def test_data_that_cannot_be_made_count_in_no_rate(monkeypatch):
    def impossible(*_, **__):
        raise NoSuchEffect("no strength of perfusion found with d' = 9")

    monkeypatch.setattr(diagnosis_hmi, "measured", impossible)
    line = diagnosis_hmi.one_set(diagnosis_hmi.Condition("removed", "perfusion", 9.0), 5, bench=object())
    assert line["seed"] == 5 and "no strength" in line["why"]
    summary = summarise([line], {})
    assert summary["data sets"] == 0 and summary["no such data"] == 1 and summary["removed"] == {}


def test_error_of_a_rate_is_that_of_wilson():
    assert rate([True] * 30 + [False] * 70)["error"] == pytest.approx(np.sqrt(0.3 * 0.7 / 100), rel=0.02)
    assert 0.0 < rate([True] * 20)["error"] < 0.05 and rate([])["sets"] == 0


def test_effects_that_nobody_would_believe_count_in_no_rate(monkeypatch):
    """Conduction 13 times as good is d' 4.5 in one tissue."""
    monkeypatch.setattr(diagnosis_hmi, "measured", lambda *_: (None, {"strength": 13.0}))
    line = diagnosis_hmi.one_set(diagnosis_hmi.Condition("known", "conductivity-change", 4.5), 5, bench=object())
    assert "13, where 0.3 is plausible" in line["why"] and summarise([line], {})["no such data"] == 1
    assert diagnosis_hmi.implausible("conductivity-change", -3.1) and not diagnosis_hmi.implausible("bump", 13.0)
    assert not diagnosis_hmi.implausible("conductivity-change", 2.9)


def test_what_a_diagnosis_lists_as_not_testable_is_counted_beside_its_rates(tmp_path):
    one = {"first": "perfusion", "named": ["perfusion"], "confusable": [], "possible": ["perfusion"], "seconds": 1.0}
    one |= {"part": "known", "name": "perfusion", "verdict": "named", "noise": "white", "testable": True}
    other = one | {"name": "tracking-jitter", "testable": False}
    lines = [*({"d_prime": d} | line for d in (4.5, 6.0) for line in (one, other)), other | {"verdict": NO_DATA}]
    limit = {d: {"perfusion": {"detected": 0.97, "first": 0.8}} for d in ("4.5", "6")}
    summary = summarise(lines, limit)
    assert summary["all known"]["4.5"]["detected"] == rate([True]) and set(summary["known"]["6"]) == {"perfusion"}
    write_docs({"seeds": "test", **summary}, tmp_path, HMI_STUDY)
    page = (tmp_path / HMI_STUDY.page).read_text()
    assert "1 more count in no rate" in page
    assert "In 2 of 4 data sets with a known cause (tracking-jitter) the diagnosis lists" in page
    assert "given other names: 2." in page


@pytest.mark.slow
def test_a_stand_in_takes_what_is_like_it_and_leaves_no_more_than_there_was():
    """Two slow relaxations of tissue are alike; nothing else that an analyser does has a threshold as slip has."""

    def quiet(name, d_prime):
        given = {"name": name, "d_prime": d_prime, "noise": "none"}
        return diagnosis.measured(200, **given)[0], diagnosis.blind.NOISE

    found = removed_limits(quiet, ["second-relaxation", "slip"], [9.0])["9"]
    assert found["second-relaxation"]["stand-in"] == "poroelastic-drainage"
    assert found["second-relaxation"]["left"] < 1.5 < 6.0 < found["slip"]["left"] < 9.2
    assert found["second-relaxation"]["noise known"] < 0.5 < found["slip"]["noise known"]


def test_a_cause_of_which_no_strength_shows_stays_in_the_table_of_rests(tmp_path):
    def quiet(name, d_prime):
        raise NoSuchEffect(f"no strength of {name} leaves d' = {d_prime:g}")

    found = removed_limits(quiet, ["slip"], [9.0])
    line = {"part": "removed", "name": "slip", "verdict": NO_DATA, "noise": "white", "d_prime": 9.0, "first": None}
    write_docs({"seeds": "test", "model": "fractional", **summarise([line], {}, found)}, tmp_path, DMA_STUDY)
    assert "| 9 | slip | no strength of slip leaves d' = 9 | – | – | – |" in (tmp_path / DMA_STUDY.page).read_text()

    def broken(name, d_prime):
        raise ValueError("something else")

    with pytest.raises(ValueError, match="something else"):
        removed_limits(broken, ["slip"], [9.0])


def test_of_linear_effects_a_stand_in_leaves_what_is_across_it():
    """At 60 degrees from another cause the sine is left; one that has a single sign takes nothing of the other."""
    axes = np.eye(40)
    order = series("time", [0] * 40, np.arange(40.0))
    family = noise_family((order,), np.arange(40.0) + 1.0)[:1]
    near = 0.5 * axes[:, [1]] + np.sqrt(0.75) * axes[:, [2]]
    causes = [Alternative(name, effect, sign) for name, effect, sign in (("own", axes[:, [1]], 0), ("near", near, 1))]
    design = Design(axes[:, :1], causes, {}, family)
    effects = {"own": [axes[:, 1]], "against": [-near[:, 0]], "strange": [axes[:, 1], near[:, 0]]}
    found = linear_rests([design], [effects], [4.0], level=0.25)["4"]
    assert found["own"]["stand-in"] == "near" and found["own"]["left"] == pytest.approx(4.0 * np.sqrt(0.75))
    assert found["own"]["noise known"] == pytest.approx(stats.norm.cdf(4.0 * np.sqrt(0.75) - stats.norm.isf(0.25)))
    # What the noise is costs little where 38 data tell it.
    assert found["own"]["noise unknown"] == pytest.approx(found["own"]["noise known"], abs=0.03)
    assert found["against"]["stand-in"] == "own" and found["against"]["left"] == pytest.approx(4.0 * np.sqrt(0.75))
    assert found["strange"]["left"] == pytest.approx(0.0, abs=1e-12)


def test_limit_of_a_cause_is_that_of_designs_that_can_show_it():
    """One that the fit imitates in a design is none that a diagnosis could find there."""
    rng = np.random.default_rng(3)
    fitted, effect = rng.standard_normal((40, 3)), rng.standard_normal((40, 1))
    order = series("time", [0] * 40, np.arange(40.0))
    family = noise_family((order,), np.arange(40.0) + 1.0)[:1]
    truths = {"seen": {1: effect / projected_length(effect, fitted)}}
    shows = Design(fitted, [Alternative("seen", effect)], truths, family)
    blind_to_it = Design(fitted, [Alternative("other", rng.standard_normal((40, 1)))], truths, family)
    alone = limits([shows], [4.5])
    assert limits([shows, blind_to_it], [4.5]) == alone and alone["4.5"]["seen"]["detected"] > 0.9
    line = {"part": "known", "name": "seen", "verdict": "named", "noise": "white", "d_prime": 4.5, "first": "seen"}
    line |= {"named": ["seen"], "confusable": [], "possible": ["seen"], "seconds": 1.0}
    assert "limit" not in summarise([line], limits([blind_to_it], [4.5]))["known"]["4.5"]["seen"]


def test_page_of_real_measurements_says_what_was_found():
    gain = dict(
        split="5 blocks", rmse_before=0.12, rmse_before_error=0.02, rmse_after=0.025, rmse_after_error=0.004,
        log_score_gain=1.5, standard_error=0.2,
    )  # fmt: skip
    polymer = {
        "verdict": "unexplained", "named": ["power-law-relaxation"],
        "strengths": {"power-law-relaxation": [0.6, 0.5, 0.7]},
        "gain": gain, "unexplained": "along frequency: 4 % below the model at 1 Hz",
    }  # fmt: skip
    measurement = {"words": "a push of 0.2 ms"}
    curves = {
        "seed": 3, "omnibus": {"p_value": 0.049}, "verdict": "confusable", "named": [], "gain": None,
        "confusable": [["perfusion", "damage-law"]], "separation": [{"measurement": measurement}],
        "not testable": ["boiling", "path-heating"], "facts": ["- Sonication 1, end: 96 at 84 degC measured."],
        "between": "97 at 44 degC | 112 at 58 degC | 54 at 84 degC",
    }  # fmt: skip
    said = real_data.page({"polymer": polymer, "curves": [curves], "one frequency": [0.2, 0.5, 1.2]})
    assert "`power-law-relaxation` is named (strength 0.6, 0.5 to 0.7)" in said
    assert "from 12 ± 2 to 2.5 ± 0.4 %" in said and "4 % below the model at 1 Hz." in said
    assert "error of 50 % " in said and "20 to 120)" in said
    assert "| 3 | 0.049 | `confusable` | `perfusion`, `damage-law` | – |" in said
    assert "boiling, path-heating. What would separate causes best: a push of 0.2 ms." in said
    assert "96 at 84 degC measured" in said
    assert "| simulated here | 97 at 44 degC | 112 at 58 degC | 54 at 84 degC |" in said


def test_answers_of_a_record_are_compared_with_those_of_the_code_here(tmp_path, monkeypatch, capsys):
    lines = [
        {"part": "known", "name": "slip", "d_prime": 4.5, "noise": "white", "share": 1, "model": "zener", "seed": seed}
        | {"verdict": "named", "p": 0.01, "first": "slip", "named": ["slip"], "stamp": "old"}
        for seed in range(10)
    ]
    asked = []

    def one_set(condition, seed):
        asked.append((condition, seed))
        answer = lines[seed] | {"stamp": "new", "seconds": 1.0}
        return answer | ({"verdict": "unexplained", "p": 0.02, "named": []} if seed == 4 else {})

    monkeypatch.setattr(diagnosis_again.diagnosis, "one_set", one_set)
    record = tmp_path / "record.jsonl"
    record.write_text("".join(json.dumps(line) + "\n" for line in lines))
    monkeypatch.setattr("sys.argv", ["diagnosis_again", str(record), "--sets", "5"])
    diagnosis_again.main()
    said = json.loads(capsys.readouterr().out)
    assert [seed for _, seed in asked] == [0, 2, 4, 6, 8] and asked[0][0].model == "zener"
    assert said["data sets"] == 5 and said["largest change of p"] == pytest.approx(1.0)
    assert said["differing"] == [{"seed": 4, "verdict": ["named", "unexplained"], "named": [["slip"], []]}]
