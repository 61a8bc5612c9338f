"""Times, memory and errors of the sound field: the five-layer case at 50 W and 150 W, and how they grow, as JSON.

python -m benchmarks.acoustics --out results/benchmarks/acoustics.json

Every number of the model but the thicknesses is an argument of what is timed, so that nothing is computed before.
Derivatives are those of the largest heat to power, liver's attenuation and its sound speed. Errors are the largest
about the focus, against the stored solutions of `tests/reference/acoustics`, relative to their peaks.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import dataclasses
import json
import math
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import arfjax as ax
from arfjax.acoustics.diffraction import Diffraction, ExactOneWay, Parabolic
from arfjax.acoustics.field import HarmonicField
from arfjax.acoustics.intensity import heat_deposition
from arfjax.acoustics.one_way import AcousticLayer, MarchSettings, solve_field
from arfjax.acoustics.sources.projected_bowl import ProjectedBowl
from arfjax.transducer import Drive, PressureDrive
from benchmarks.hitu import BOWL, FREQUENCY, REFERENCE, T1_PRESSURE, layers, settings_of

LENGTH = sum(layer.thickness for layer in layers())
MUSCLE_END = 56e-3
FOCUS = (57e-3, 70e-3)
"""Where errors are measured [m]: before, the references' own are larger."""

LIMITS = {"p_positive": 1e-3, "p_negative": 1e-3, "heat": 3e-3}
START = {"start_plane": 9.297e-3, "n_quadrature": 640, "steepens_from_source": False}
"""As in the references, sound steepens from this plane on."""

SETTINGS = {
    50: MarchSettings(n_harmonics=20, axial_step=0.505e-3, **START),
    150: MarchSettings(n_harmonics=48, n_radial=576, axial_step=0.421e-3, **START),
}
TARGETS_S = {50: {"float32": 0.25, "float64": 0.5}, 150: {"float32": 1.5, "float64": 3.0}}
PAPER = MarchSettings(n_harmonics=128, n_radial=672, axial_step=(LENGTH - START["start_plane"]) / 2019, **START)
PAPER_TARGET_S = 15.0
PAPERS_RUN = "paper's run"
PRECISIONS = {"float32": False, "float64": True}


@dataclasses.dataclass(frozen=True)
class Plan:
    """What is measured."""

    case: list[AcousticLayer] = dataclasses.field(default_factory=layers)
    powers: tuple[int, ...] = (50, 150)
    settings: dict[int, MarchSettings] = dataclasses.field(default_factory=lambda: SETTINGS)
    default: MarchSettings | None = MarchSettings(n_harmonics=24)
    paper: MarchSettings = PAPER
    precisions: tuple[str, ...] = ("float32", "float64")
    references: tuple[str, ...] = ("T1", "T2", "T3")
    checkpoints: tuple[int, ...] = (1, 14)
    harmonics: tuple[int, ...] = (16, 32, 64)
    radial: tuple[int, ...] = (128, 256, 512)
    layers: tuple[int, ...] = (1, 5, 10)
    batches: tuple[int, ...] = (1, 8, 64)
    growing: MarchSettings = MarchSettings(n_harmonics=32, axial_step=0.449e-3, **START)
    repeats: int = 9


_TINY = MarchSettings(n_harmonics=5, n_radial=112, axial_step=4e-3, start_plane=12e-3, n_quadrature=256)
QUICK = Plan(
    case=[AcousticLayer(layers()[0].medium, MUSCLE_END), AcousticLayer(layers()[-1].medium, LENGTH - MUSCLE_END)],
    powers=(50,),
    settings={50: _TINY},
    default=None,
    paper=_TINY,
    precisions=("float32",),
    references=("T3",),
    checkpoints=(1,),
    harmonics=(5, 8),
    radial=(),
    layers=(),
    batches=(2,),
    growing=_TINY,
    repeats=1,
)
"""The same in seconds, with settings that resolve nothing: whether it runs."""


class Compiled:
    """A function compiled for its arguments, which times itself."""

    def __init__(self, function: Callable, *arguments: Any) -> None:
        """Compile."""
        started = time.perf_counter()
        lowered = jax.jit(function).lower(*arguments)
        self.trace_s, started = time.perf_counter() - started, time.perf_counter()
        self.run = lowered.compile()
        self.compile_s, self.arguments = time.perf_counter() - started, arguments
        analysis = self.run.memory_analysis()
        self.temp_mb = math.nan if analysis is None else analysis.temp_size_in_bytes / 1e6

    def seconds(self) -> float:
        """Of one run."""
        started = time.perf_counter()
        jax.block_until_ready(self.run(*self.arguments))
        return time.perf_counter() - started

    def described(self, runs: list[float]) -> dict[str, float]:
        """What goes into the file."""
        return {
            "median_s": round(statistics.median(runs), 5),
            "min_s": round(min(runs), 5),
            "repeats": len(runs),
            "trace_s": round(self.trace_s, 2),
            "compile_s": round(self.compile_s, 2),
            "temp_mb": round(self.temp_mb, 2),
        }


def measured(functions: list[Compiled], repeats: int) -> list[dict[str, float]]:
    """Times of several functions, taken in turn so that other load meets all of them alike."""
    for function in functions:
        function.seconds()
    rounds = [[function.seconds() for function in functions] for _ in range(repeats)]
    return [function.described(list(runs)) for function, runs in zip(functions, zip(*rounds, strict=True), strict=True)]


def numbers(power: float, media: list[AcousticLayer]) -> tuple[dict, tuple]:
    """What derivatives are taken to, and the rest of the model."""
    liver = media[-1].medium
    wanted = {"power": power, "attenuation": liver.attenuation, "sound_speed": liver.sound_speed}
    return jax.tree.map(lambda value: jnp.asarray(value, dtype=float), (wanted, (BOWL, media)))


def on_axis(settings: MarchSettings, z: np.ndarray, diffraction: Diffraction = ExactOneWay()) -> Callable:  # noqa: B008
    """Pressure and heat on the axis; the estimate of the error is not used, so that it is not computed."""

    def run(wanted: dict, rest: tuple) -> tuple[jax.Array, jax.Array]:
        bowl, media = rest
        liver = eqx.tree_at(
            lambda medium: (medium.attenuation, medium.sound_speed),
            media[-1].medium,
            (wanted["attenuation"], wanted["sound_speed"]),
        )
        media = [*media[:-1], AcousticLayer(liver, media[-1].thickness)]
        drive = Drive(FREQUENCY, wanted["power"])
        field = solve_field(bowl, drive, media, r=np.zeros(1), z=z, settings=settings, diffraction=diffraction)
        return field.pressure[:, 0], heat_deposition(field)[0]

    return run


def largest_heat(run: Callable) -> Callable:
    """The number of which derivatives are taken."""
    return lambda wanted, rest: jnp.max(run(wanted, rest)[1])


def positions(stored_z: np.ndarray, spacing: float) -> np.ndarray:
    """Every so many of the stored positions, from 40 mm to the end of liver."""
    every = max(1, int(spacing / np.median(np.diff(stored_z)) + 1e-6))
    return stored_z[(stored_z > 40e-3) & (stored_z < LENGTH - 1e-6)][::every]


def extremes(pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Highest and lowest pressure over a period; harmonics along the first axis."""
    n = 16 * pressure.shape[0]
    wave = np.fft.irfft(np.pad(pressure, ((1, 0), (0, 0))), n=n, axis=0) * 0.5 * n
    return wave.max(axis=0), wave.min(axis=0)


def errors(name: str, power: float, settings: MarchSettings) -> dict[str, float | bool]:
    """Of pressures and heat about the focus, against one of the stored solutions."""
    stored = np.load(REFERENCE / f"{name}_P{power:.0f}.npz")
    z = positions(stored["z_m"], settings.axial_step)
    field = _as_stored(name, power, settings, z)
    near = (z > FOCUS[0]) & (z < FOCUS[1])
    kept = np.searchsorted(stored["z_m"], z[near] - 1e-9)
    positive, negative = extremes(np.asarray(field.pressure[:, 0], dtype=complex)[:, near])
    found = {"p_positive": positive, "p_negative": negative, "heat": np.asarray(heat_deposition(field))[0, near]}
    keys = dict(zip(LIMITS, ("p_pos_axis_pa", "p_neg_axis_pa", "heat_axis_w_m3"), strict=True))
    off = {
        key: float(np.max(np.abs(found[key] - stored[keys[key]][kept])) / np.max(np.abs(stored[keys[key]][kept])))
        for key in LIMITS
    }
    return {**{key: round(value, 6) for key, value in off.items()}, "within": all(off[k] < LIMITS[k] for k in off)}


def _as_stored(name: str, power: float, settings: MarchSettings, z: np.ndarray) -> HarmonicField:
    """The field with the physics of a stored solution."""
    projected = ProjectedBowl(BOWL, fade_grazing=True), PressureDrive(FREQUENCY, T1_PRESSURE * (power / 50.0) ** 0.5)
    bowl, along_axis = (BOWL, Drive(FREQUENCY, float(power))), ExactOneWay(steepening_along_ray=False)
    (source, drive), diffraction = {
        "T1": (projected, ExactOneWay(absorption_along_ray=False, steepening_along_ray=False)),
        "T2": (bowl, along_axis),
        "T3": (bowl, ExactOneWay()),
    }[name]
    return eqx.filter_jit(
        lambda drive: solve_field(
            source, drive, layers(), r=np.zeros(1), z=z, settings=settings, diffraction=diffraction
        )
    )(drive)


def forward_and_gradient(power: float, settings: MarchSettings, z: np.ndarray, plan: Plan) -> dict:
    """Times of both, the ratio of their medians, and the memory that XLA sets aside, for each way of checkpointing."""
    arguments = numbers(power, plan.case)
    result, forward = {}, Compiled(on_axis(settings, z), *arguments)
    for every in plan.checkpoints:
        run = on_axis(dataclasses.replace(settings, steps_per_checkpoint=every), z)
        gradient = Compiled(jax.value_and_grad(largest_heat(run)), *arguments)
        ours, theirs = measured([forward, gradient], plan.repeats)
        ratio = round(theirs["median_s"] / ours["median_s"], 2)
        result[f"gradient, {every} steps per checkpoint"] = {**theirs, "over_forward": ratio}
        result.setdefault("forward", ours)
    return result


def five_layers(power: int, plan: Plan, settings: MarchSettings, references: tuple[str, ...]) -> dict:
    """The case, in each precision: errors and times."""
    z = positions(np.load(REFERENCE / f"T3_P{power}.npz")["z_m"], settings.axial_step)
    result: dict = {"settings": settings_of(settings), "positions": len(z)}
    for precision in plan.precisions:
        with jax.enable_x64(PRECISIONS[precision]):
            result[precision] = {
                "errors": {name: errors(name, power, settings) for name in references},
                **forward_and_gradient(power, settings, z, plan),
                "target_s": TARGETS_S[power][precision],
            }
    return result


def growth(plan: Plan) -> dict:
    """Time and memory over harmonics, Bessel terms and layers (of equal thickness), and their exponents."""
    one = layers()[3].medium

    def split(n: int) -> list[AcousticLayer]:
        return [AcousticLayer(one, LENGTH / n)] * n

    cases = {
        "harmonics": [(n, dataclasses.replace(plan.growing, n_harmonics=n), split(1)) for n in plan.harmonics],
        "radial": [(n, dataclasses.replace(plan.growing, n_radial=n), split(1)) for n in plan.radial],
        "layers": [(n, _fitting(plan.growing, LENGTH / n), split(n)) for n in plan.layers],
    }
    return {name: _growth(rows, plan) for name, rows in cases.items() if rows}


def _fitting(settings: MarchSettings, thickness: float) -> MarchSettings:
    return dataclasses.replace(settings, start_plane=min(settings.start_plane, 0.97 * thickness))


def _growth(rows: list[tuple[int, MarchSettings, list[AcousticLayer]]], plan: Plan) -> dict:
    found: dict[str, list] = {"sizes": [size for size, _, _ in rows]}
    for _, settings, media in rows:
        run, arguments = on_axis(settings, np.asarray([LENGTH])), numbers(50.0, media)
        pair = [Compiled(run, *arguments), Compiled(jax.value_and_grad(largest_heat(run)), *arguments)]
        for name, each in zip(("forward", "gradient"), measured(pair, min(plan.repeats, 3)), strict=True):
            for key in ("median_s", "temp_mb", "compile_s"):
                found.setdefault(f"{name}_{key}", []).append(each[key])
    logarithms = np.log(found["sizes"])
    exponents = {
        key: round(float(np.polyfit(logarithms, np.log(values), 1)[0]), 2)
        for key, values in found.items()
        if key != "sizes"
    }
    return {**found, "exponents": exponents}


def batches(plan: Plan) -> list[dict]:
    """Fields of many attenuations of liver at once: layers before liver are marched once."""
    settings, z, rows = plan.settings[50], np.linspace(60e-3, 66e-3, 5), []
    wanted, rest = numbers(50.0, plan.case)

    def run(attenuations: jax.Array, wanted: dict, rest: tuple) -> jax.Array:
        return jax.vmap(lambda lost: on_axis(settings, z)({**wanted, "attenuation": lost}, rest)[1])(attenuations)

    for size in plan.batches:
        each = Compiled(run, wanted["attenuation"] * jnp.linspace(0.8, 1.2, size), wanted, rest)
        found = measured([each], min(plan.repeats, 3))[0]
        rows.append({"members": size, **found, "per_member_s": round(found["median_s"] / size, 5)})
    return rows


def papers_run(plan: Plan) -> dict:
    """128 harmonics, 2019 axial steps, 672 radial terms, by the KZK equation: as the paper has it."""
    settings = plan.paper
    z = np.linspace(MUSCLE_END, LENGTH, int(np.ceil((LENGTH - MUSCLE_END) / settings.axial_step)) + 1)
    result: dict = {"settings": settings_of(settings), "target_s": PAPER_TARGET_S}
    for precision in plan.precisions:
        with jax.enable_x64(PRECISIONS[precision]):
            run = Compiled(on_axis(settings, z, Parabolic()), *numbers(50.0, plan.case))
            result[precision] = run.described([run.seconds() for _ in range(min(plan.repeats, 3))])
    return result


def report(name: str, case: dict, precision: str) -> None:
    """One line for each precision of a case."""
    found = case[precision]
    worst = {key: max(each[key] for each in found["errors"].values()) for key in LIMITS}
    said = ", ".join(
        f"{key} {each['median_s']:.3f} s, {each['over_forward']} times forward, {each['temp_mb']:.0f} MB"
        for key, each in found.items()
        if key.startswith("gradient")
    )
    print(
        f"{name}, {precision}: forward {found['forward']['median_s']:.3f} s (min {found['forward']['min_s']:.3f}, "
        f"asked {found['target_s']}), {found['forward']['temp_mb']:.0f} MB; {said}; errors "
        + ", ".join(f"{key} {value:.1e}" for key, value in worst.items()),
        flush=True,
    )


def measure(plan: Plan) -> dict:
    """All of it."""
    result: dict = {
        "benchmark": "acoustics",
        "device": str(jax.devices()[0]),
        "machine": platform.machine(),
        "cpu_count": os.cpu_count(),
        "load_before": os.getloadavg()[0],
        "versions": {"arfjax": ax.__version__, "jax": jax.__version__, "python": platform.python_version()},
    }
    for power in plan.powers:
        name = f"five layers, {power} W"
        result[name] = five_layers(power, plan, plan.settings[power], plan.references)
        for precision in plan.precisions:
            report(name, result[name], precision)
    if plan.default is not None:
        name = "five layers, 50 W, start plane of the defaults"
        result[name] = five_layers(50, plan, plan.default, ("T3",))
        for precision in plan.precisions:
            report(name, result[name], precision)
    for precision in plan.precisions[-1:]:  # they grow alike
        with jax.enable_x64(PRECISIONS[precision]):
            result[f"growth, {precision}"] = growth(plan)
            result[f"attenuations at once, {precision}"] = batches(plan)
        for name, case in result[f"growth, {precision}"].items():
            print(f"exponents over {name}, {precision}: {case['exponents']}", flush=True)
        for row in result[f"attenuations at once, {precision}"]:
            print(f"{row['members']} attenuations, {precision}: {row['per_member_s']:.4f} s each", flush=True)
    result[PAPERS_RUN] = papers_run(plan)
    for precision in plan.precisions:
        print(f"paper's run, {precision}: {result[PAPERS_RUN][precision]['median_s']:.2f} s", flush=True)
    result["load_after"] = os.getloadavg()[0]
    return result


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--quick", action="store_true", help="whether it runs: settings that resolve nothing")
    parsed = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    result = measure(QUICK if parsed.quick else Plan())
    parsed.out.parent.mkdir(parents=True, exist_ok=True)
    parsed.out.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
