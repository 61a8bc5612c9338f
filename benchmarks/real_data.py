"""What the diagnosis says of the real measurements that are shipped, as a page and as JSON.

python -m benchmarks.real_data --docs docs --workers 2

A polymer's frequency sweeps examined as conventional solids, and predicted from their relaxation at one frequency; the
measured HMI values of Suomi et al. 2016 in the paper's own simulation, with several seeds, because eleven values are
so few that the answer may hang on them. Ten to twenty minutes.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import dataclasses
import json
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Float

import arfjax as ax
import inverse
from benchmarks.spread import spread
from inverse.datasets.dma import Sweep, group_sweeps, read_dma
from inverse.datasets.shipped import shipped
from inverse.diagnosed import Diagnosed
from inverse.diagnosis.diagnosis import Diagnosis
from inverse.diagnosis.hmi.account import HmiAccount
from inverse.diagnosis.hmi.features import Curve

PUBLISHED = Path(__file__).parents[1] / "examples" / "suomi2016_published.toml"
SEEDS = 5
PAGE = "real_measurements.md"
_KEPT = ("verdict", "omnibus", "named", "confusable", "gain", "unexplained", "separation", "seed")


def diagnosed(which: str, seed: int) -> dict[str, Any]:
    """What is said of the polymer or of the paper's curves."""
    if which == "polymer":
        return _said(inverse.diagnose(shipped("pyvisco_polymer"), model="zener", seed=seed), which)
    return _said(inverse.diagnose(hmi=shipped("suomi2016_hmi"), experiment=PUBLISHED, seed=seed), which)


def _said(found: Diagnosed, which: str) -> dict[str, Any]:
    details = found.details
    between = {"between": simulated_between(details)} if which == "curves" else {}
    return {
        **between,
        "which": which,
        **{key: found.content[key] for key in _KEPT},
        "facts": details.account.facts(details.in_question),
        "strengths": {
            one["name"]: [one["estimate"], *one["interval"]]
            for one in found.content["causes"]
            if one["status"] in ("named", "confusable")
        },
        "not testable": [one["name"] for one in found.content["not_testable"]],
    }


def simulated_between(found: Diagnosis) -> str:
    """Dip, peak and end of the curve that the fitted simulation draws between the readings, as cells of a table.

    Of a sonication that heats the focus to the hottest reading, in percent of the displacement at 37 degC.
    """
    account = found.account
    assert isinstance(account, HmiAccount)
    problem, null = account.problem, account.null
    model, hottest = problem.program.model(null.unknowns), float(np.nanmax(problem.rows.temperature))
    protocol = dataclasses.replace(ax.read_experiment(PUBLISHED).stepwise(), final_temperature=hottest)
    settings, temperature = ax.discretise(model), np.arange(37.0, hottest + 0.5)
    heating = ax.simulate_heating(model, protocol, settings)
    moved = np.asarray(ax.stepwise_displacement(model, jnp.asarray(temperature), protocol, settings, heating=heating))
    return Curve("simulated", temperature, 100.0 * moved / moved[0]).cells()


def modulus_of(sweep: Sweep) -> Complex[np.ndarray, " row"]:
    """Measured complex modulus of a sweep [Pa].

    Raises:
        ValueError: if it has magnitudes alone.
    """
    storage, loss = sweep.data.storage_modulus, sweep.data.loss_modulus
    if storage is None or loss is None:
        raise ValueError("a relaxation at one frequency takes storage and loss modulus")
    return storage + 1j * loss


def from_one_frequency(
    frequency_hz: Float[np.ndarray, " row"], modulus: Complex[np.ndarray, " row"], row: int
) -> Complex[np.ndarray, " row"]:
    """A Maxwell element through the modulus at one frequency, as the constants of the NIST foam were made [Pa].

    Args:
        frequency_hz: Of the sweep.
        modulus: Measured [Pa].
        row: Where the element goes through it.
    """
    omega = 2.0 * np.pi * frequency_hz
    time = modulus[row].real / (omega[row] * modulus[row].imag)
    branch = abs(modulus[row]) ** 2 / modulus[row].real
    return branch * 1j * omega * time / (1.0 + 1j * omega * time)


def errors_from_one_frequency(sweeps: Sequence[Sweep]) -> list[float]:
    """Root mean square relative error of each sweep [1], predicted from its middle frequency."""
    errors = []
    for sweep in sweeps:
        modulus = modulus_of(sweep)
        predicted = from_one_frequency(sweep.data.frequency_hz, modulus, len(modulus) // 2)
        errors.append(float(np.sqrt(np.mean(np.abs(np.log(predicted / modulus)) ** 2))))
    return errors


def page(summary: dict[str, Any]) -> str:
    """The page."""
    curves = summary["curves"]
    return "\n".join(
        [
            "# What the diagnosis says of real measurements",
            "",
            "Made by `python -m benchmarks.real_data --docs docs --workers 2`. Nobody knows the truth here: how often "
            "answers are right is measured on simulated data ([DMA](operating_characteristic.md), [conventional "
            "model](operating_characteristic_zener.md), [HMI](operating_characteristic_hmi.md)).",
            "",
            *_of_polymer(summary["polymer"], summary["one frequency"]),
            *_of_curves(curves),
            *curves[0]["facts"],
            *_between(curves[0]["between"]),
            "The foam of NIST, which is shipped too, has one frequency: nothing can be said of what its model lacks, "
            "and `arfjax diagnose` refuses it.",
            "",
        ]
    )


def _of_polymer(found: dict[str, Any], errors: Sequence[float]) -> list[str]:
    gain, (name,) = found["gain"], found["named"]
    strength, lower, upper = found["strengths"][name]
    return [
        "## A polymer in conventional solids",
        "",
        "21 sweeps of a polymer through its glass transition (`arfjax data pyvisco_polymer`), a conventional solid "
        f"fitted to each: `{name}` is named (strength {strength:.3g}, {lower:.3g} to {upper:.3g}), one order for all "
        f"sweeps. At what was left out ({gain['split']}) errors go from {_percent(gain, 'before')} to "
        f"{_percent(gain, 'after')} % (root mean square), the log score rises by {gain['log_score_gain']:.3g} ± "
        f"{gain['standard_error']:.2g} nat a datum. The verdict is `{found['verdict']}`: that is not all. "
        f"{_sentence(found['unexplained'])}",
        "",
        "## The same polymer from one frequency",
        "",
        "Constants of the NIST foam are a Maxwell element through the modulus at one frequency. Made so of each of "
        "these sweeps, at its middle frequency, where it is right, the prediction of the rest of the sweep has an "
        f"error of {100.0 * np.median(errors):.0f} % (root mean square of the difference of logarithms, median of the "
        f"sweeps; {100.0 * min(errors):.0f} to {100.0 * max(errors):.0f}). What a single relaxation lacks is the "
        "cause above. (The recipe is the foam's, the sweeps are the polymer's: there are none of the foam.)",
        "",
    ]


def _percent(gain: dict[str, Any], when: str) -> str:
    return f"{100.0 * gain[f'rmse_{when}']:.3g} ± {100.0 * gain[f'rmse_{when}_error']:.2g}"


def _sentence(words: str | None) -> str:
    return "" if not words else f"What is left has no name: {words}."


def _of_curves(found: Sequence[dict[str, Any]]) -> list[str]:
    rows = [
        f"| {one['seed']} | {one['omnibus']['p_value']:.2g} | `{one['verdict']}` | {_names(one)} | {_gain(one)} |"
        for one in found
    ]
    measurements = {
        apart["measurement"]["words"] for one in found for apart in one["separation"] if apart["measurement"]
    }
    hidden = sorted(set.intersection(*(set(one["not testable"]) for one in found)))
    return [
        "## The paper's curves in the paper's simulation",
        "",
        "Eleven HMI values of three sonications (`arfjax data suomi2016_hmi`) in the simulation of Suomi et al. 2016 "
        "with the constants that it gives, but for the lesion's stiffness, which is fitted "
        "(`examples/suomi2016_published.toml`). Seeds draw the replicates and what the fast simulation learns from; "
        "the gain is on one sonication left out at a time, in percent of displacement and nat a datum.",
        "",
        "| seed | p | verdict | causes | error before, after [%], log score |",
        "| ---: | ---: | --- | --- | --- |",
        *rows,
        "",
        f"Not to be seen in so few values: {', '.join(hidden)}. "
        + (f"What would separate causes best: {'; '.join(sorted(measurements))}." if measurements else ""),
        "",
    ]


def _between(here: str) -> list[str]:
    """What readings at a few temperatures do not show."""
    return [
        "Between the readings, in percent of the displacement at 37 degC (the paper's simulation: at 35):",
        "",
        "| | dip | peak | end |",
        "| --- | --- | --- | --- |",
        "| measured in three | 96 to 99 at 45 to 50 degC | 100 to 110 at 59 to 70 degC | 65 to 96 at 84 degC |",
        "| simulated in the paper | 95 at 40 to 45 degC | 105 at 55 degC | 49 at 70 degC |",
        f"| simulated here | {here} |",
        "",
        "The dip is that of the liver's attenuation, the peak is where a lesion begins to stiffen the focus. Whether "
        "either is wrong cannot be told from values that scatter so: only that the displacement falls too far is "
        "found, with the causes above.",
        "",
    ]


def _names(one: dict[str, Any]) -> str:
    sets = [one["named"]] if one["named"] else one["confusable"]
    return "; ".join(", ".join(f"`{name}`" for name in names) for names in sets) or "–"


def _gain(one: dict[str, Any]) -> str:
    gain = one["gain"]
    if gain is None:
        return "–"
    score = f"{gain['log_score_gain']:+.2g} ± {gain['standard_error']:.2g}"
    return f"{_percent(gain, 'before')}, {_percent(gain, 'after')}, {score}"


def main() -> None:
    """Diagnose and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/real_data.json"))
    parser.add_argument("--seeds", type=int, default=SEEDS, help="of the paper's curves")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--docs", type=Path, help="folder for the page")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    todo = [("polymer", 0), *(("curves", seed) for seed in range(given.seeds))]
    found = list(spread(diagnosed, todo, workers=given.workers))
    summary = {
        "benchmark": "real_data",
        "polymer": next(one for one in found if one["which"] == "polymer"),
        "curves": sorted((one for one in found if one["which"] == "curves"), key=lambda one: one["seed"]),
        "one frequency": errors_from_one_frequency(group_sweeps(read_dma(shipped("pyvisco_polymer")))),
        "versions": {"arfjax": ax.__version__, "jax": jax.__version__, "python": platform.python_version()},
    }
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(summary, indent=2) + "\n")
    if given.docs is not None:
        given.docs.mkdir(parents=True, exist_ok=True)
        (given.docs / PAGE).write_text(page(summary))


if __name__ == "__main__":
    main()
