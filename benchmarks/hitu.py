"""The five-layer case beside the free simulator HITU_Simulator (GPL-3, in Octave), in one run, as JSON.

python -m benchmarks.hitu --checkout PATH [--octave octave-cli] [--power 50] [--harmonics 128] --out hitu.json

PATH is a checkout of github.com/jsoneson/HITU_Simulator, of which nothing is kept here. Its march is copied into a
temporary folder with the case's numbers in place of its example's and without its plots, and runs in full with its
loops over radial rows in vectorised form (`benchmarks/hitu`), and for some steps as published, from which the time of
all is extrapolated. Before, both run the case on a coarse grid and must agree, so that what is timed is still that
simulator. Errors of both codes are against the stored solutions of `tests/reference/acoustics`.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import dataclasses
import json
import platform
import re
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.io import loadmat

import arfjax as ax
from arfjax.acoustics.diffraction import ExactOneWay
from arfjax.acoustics.intensity import heat_deposition
from arfjax.acoustics.one_way import AcousticLayer, MarchSettings, solve_field
from arfjax.acoustics.sources.projected_bowl import ProjectedBowl
from arfjax.media import AcousticMedium
from arfjax.suomi2016 import TABLE_1_ACOUSTIC
from arfjax.transducer import Drive, FocusedBowl, PressureDrive
from arfjax.units import from_db_per_cm

REFERENCE = Path(__file__).parents[1] / "tests" / "reference" / "acoustics"
BOWL, FREQUENCY = FocusedBowl(32e-3, 10e-3, 62.6e-3), 1.1e6
THICKNESSES = {"water": 34e-3, "skin": 2e-3, "fat": 10e-3, "muscle": 10e-3, "liver": 40e-3}
DEPTHS = np.linspace(40e-3, 96e-3, 112)
"""Where ours is read [m]: half a millimetre apart."""
CASES = ("T1", "T2", "T3")
T1_PRESSURE = 209135.8
"""Pressure that the other code takes on the bowl for 50 W [Pa]."""
SETTINGS = MarchSettings(
    n_harmonics=20, axial_step=0.505e-3, start_plane=9.297e-3, n_quadrature=400, steepens_from_source=False
)
"""What `benchmarks/acoustics.py` takes at 50 W, within 0.1 % of the references; as in those, sound steepens from the
start plane on."""
OURS = Path(__file__).parent / "hitu"
PUBLISHED_AT = "8f9a7f9"
"""Commit for which the changes below were written."""

MUSCLE_END = 56e-3
"""Where liver begins [m from the apex]."""
PROFILES = ("z_m", "p_pos_axis_pa", "p_neg_axis_pa", "heat_axis_w_m3")

ENDS_OF_STEPS = re.compile(r"^ *%collect.*$", re.MULTILINE)
ROWS_OF_POWER = re.compile(r"^ *for jj=1:Grid\.JJ.*?^ *end$", re.MULTILINE | re.DOTALL)
SAME = 1e-10
"""Relative difference up to which two runs are taken to do the same; rounding makes some 1e-13."""

CHANGES = [
    (re.compile(r"^function.*WAKZK\(\)", re.MULTILINE), "function [Grid,Layer,Q,Ppos,Pneg] = hitu_march(asked)"),
    (
        re.compile(r"^%% Transducer.*?^% calculate wavenumber[^\n]*$", re.MULTILINE | re.DOTALL),
        "[Tx,Grid,Layer] = hitu_case(asked); II = numel(Layer); z_start = Tx.d-sqrt(Tx.d^2-Tx.a2^2);\n"
        "ppw_r = 1; ppw_z = 1; hd = 0; z_output = []; LL = 0; ll = 1;",
    ),
    (re.compile(r"^Grid\.JJ = .*$", re.MULTILINE), "Grid.JJ = asked.n_radial;"),
    (re.compile(r"^Grid\.NN = .*$", re.MULTILINE), "Grid.NN = asked.n_axial;"),
    (re.compile(r"^%+\n%% Plot routine.*\Z", re.MULTILINE | re.DOTALL), ""),
    (ENDS_OF_STEPS, 'hitu_step("done", p, Q(:,nn+1), Ppos(:,nn+1), Pneg(:,nn+1));'),
]
VECTORISED = [
    (ROWS_OF_POWER, "[I(:,nn+1), Q(:,nn+1)] = hitu_power(p, I_td, Layer(ii), dz, Grid.KK);"),
]


def fail(message: str) -> None:
    """One line, and out."""
    sys.exit(f"benchmarks.hitu: {message}")


def checked(checkout: Path, octave: str) -> None:
    """Refuse what cannot run."""
    if shutil.which(octave) is None:
        fail(f"`{octave}` is not there: install GNU Octave 7 or later, or pass its program with --octave.")
    if not (checkout / "WAKZK.m").is_file():
        fail(f"no WAKZK.m in {checkout}: clone github.com/jsoneson/HITU_Simulator and pass its path with --checkout.")


def changed(text: str, changes: list[tuple[re.Pattern[str], str]]) -> str:
    """`text` with each pattern, which must occur once, replaced."""
    for pattern, replacement in changes:
        text, count = pattern.subn(replacement.replace("\\", "\\\\"), text)
        if count != 1:
            fail(f"WAKZK.m has {count} of {pattern.pattern!r}, not one; the changes are written for {PUBLISHED_AT}.")
    return text


class Simulator:
    """The other code: a checkout and an Octave to run it."""

    def __init__(self, checkout: Path, octave: str) -> None:
        """Refuse what cannot run."""
        checked(checkout, octave)
        self.checkout, self.octave = checkout.resolve(), octave

    def describe(self) -> dict:
        """Which commit, changed or not, in which Octave."""
        version = subprocess.run([self.octave, "--version"], capture_output=True, text=True, check=True).stdout
        return {
            "repository": "github.com/jsoneson/HITU_Simulator",
            "commit": self._git("rev-parse", "HEAD"),
            "locally_changed": bool(self._git("status", "--porcelain", "--untracked-files=no")),
            "octave": version.splitlines()[0],
        }

    def _git(self, *arguments: str) -> str:
        done = subprocess.run(["git", "-C", self.checkout, *arguments], capture_output=True, text=True)
        return done.stdout.strip() if done.returncode == 0 else "unknown"

    def run(self, asked: dict, *, vectorised: bool, stop_after: int = 0) -> tuple[dict, dict]:
        """Result of a march and, when it was to stop after some steps, its state then."""
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            changes = CHANGES + (VECTORISED if vectorised else [])
            source = (self.checkout / "WAKZK.m").read_text().replace("\r\n", "\n")
            (folder / "hitu_march.m").write_text(changed(source, changes))
            asked = {**asked, "stop_after": stop_after, "state": str(folder / "state.mat")}
            paths = [self.checkout, OURS, *([OURS / "vectorised"] if vectorised else []), folder]
            self._call(paths, f"hitu_run(jsondecode('{json.dumps(asked)}'), '{folder / 'out.json'}')")
            result = json.loads((folder / "out.json").read_text())
            state = loadmat(folder / "state.mat") if stop_after else {}
            return result, {key: value for key, value in state.items() if not key.startswith("__")}

    def _call(self, paths: list[Path], command: str) -> None:
        # Each path goes ahead of those before, so that the functions here stand in for those of the same name.
        added = " ".join(f"addpath('{path}');" for path in paths)
        done = subprocess.run(
            [self.octave, "--norc", "--quiet", "--eval", f"{added} {command};"], capture_output=True, text=True
        )
        if done.returncode != 0:
            fail(f"Octave stopped: {' '.join(done.stderr.split())[-400:]}")


def largest_difference(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> dict[str, float]:
    """Largest difference of each array, relative to the largest value in it."""
    return {
        key: float(np.max(np.abs(one[key] - other[key])) / max(np.max(np.abs(one[key])), 1e-300)) for key in sorted(one)
    }


def peaks(z: np.ndarray, positive: np.ndarray, negative: np.ndarray, heat: np.ndarray) -> dict[str, float]:
    """Peak pressures on the axis [MPa] and peak heat in liver [W/cm^3], between positions by parabolas."""
    liver = z > MUSCLE_END + 1e-9
    return {
        "p_positive_mpa": top(z, positive) / 1e6,
        "p_negative_mpa": -top(z, -negative) / 1e6,
        "heat_w_cm3": top(z[liver], heat[liver]) / 1e6,
    }


def top(z: np.ndarray, values: np.ndarray) -> float:
    """Top of the parabola through the largest value and its neighbours."""
    centre = min(max(int(np.argmax(values)), 1), len(values) - 2)
    near = slice(centre - 1, centre + 2)
    curvature, slope, middle = np.polyfit(z[near] - z[centre], values[near], 2)
    return float(middle - slope**2 / (4.0 * curvature))


def errors(found: dict[str, float], name: str, power: float) -> dict[str, float] | str:
    """Relative errors against a stored solution, where there is one of this power."""
    path = REFERENCE / f"{name}_P{power:.0f}.npz"
    if not path.is_file():
        return f"no {path.name} to compare with"
    stored = np.load(path)
    exact = peaks(*(stored[key] for key in PROFILES))
    return {"against": path.name, **{key: round(found[key] / exact[key] - 1.0, 6) for key in exact}}


def as_good(ours: dict[str, float] | str, theirs: dict[str, float] | str) -> bool | str:
    """Whether none of our errors is larger; where there is nothing to compare with, that."""
    if isinstance(ours, str) or isinstance(theirs, str):
        return str(ours)
    return all(abs(ours[key]) <= abs(theirs[key]) for key in ours if key != "against")


def run_theirs(simulator: Simulator, asked: dict, n_published: int) -> dict:
    """The whole march, vectorised; some steps as published, and whether both do the same."""
    difference = compared(simulator, asked)
    ends = simulator.run(asked, vectorised=False, stop_after=n_published)[0]["step_end_s"]
    per_step = (ends[-1] - ends[0]) / (n_published - 1)
    cpu_before = children_cpu()
    full, _ = simulator.run(asked, vectorised=True)
    cpu = children_cpu() - cpu_before
    found = peaks(*(np.asarray(full[key]) for key in PROFILES))
    return {
        **simulator.describe(),
        "settings": {**asked, "diffraction": "Pade(1,1)"},
        "vectorised": {
            "seconds": round(full["seconds"], 3),
            "cpu_s": round(cpu, 3),
            "runs": 1,
            "differs_from_published_by": difference,
        },
        "as published": {
            "extrapolated": True,
            "steps_timed": n_published,
            "seconds_per_step": round(per_step, 4),
            "seconds": round(ends[0] + per_step * (asked["n_axial"] - 2), 1),
        },
        **found,
        "error": errors(found, "T1", asked["power"]),
    }


def children_cpu() -> float:
    """Processor time of ended child processes [s]: unlike the clock's it hardly grows when others use the machine."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def compared(simulator: Simulator, asked: dict) -> dict[str, float]:
    """Largest relative differences between published and vectorised loops, at the end of the case on a coarse grid."""
    coarse = {**asked, "harmonics": 16, "n_radial": 100, "n_axial": 150}
    states = [simulator.run(coarse, vectorised=kind, stop_after=coarse["n_axial"] - 1)[1] for kind in (False, True)]
    difference = largest_difference(*states)
    if not max(difference.values()) < SAME:
        fail(f"the vectorised loops are not those of this checkout: {difference}.")
    return difference


def layers() -> list[AcousticLayer]:
    """The five layers, as `hitu_case.m` has them."""
    made = []
    for name, thickness in THICKNESSES.items():
        row = TABLE_1_ACOUSTIC[name]
        loss = from_db_per_cm(row.attenuation_db_per_cm_mhz)
        medium = AcousticMedium(row.density, row.sound_speed, loss, row.absorption_exponent, row.nonlinearity_parameter)
        made.append(AcousticLayer(medium, thickness))
    return made


def run_ours(power: float, settings: MarchSettings, repeats: int) -> dict:
    """Source and physics of the other code (T1), the true bowl (T2), and as this package has it by default (T3)."""
    bowl = BOWL, Drive(FREQUENCY, power)
    projected = ProjectedBowl(BOWL, fade_grazing=True), PressureDrive(FREQUENCY, T1_PRESSURE * (power / 50.0) ** 0.5)
    along_axis = ExactOneWay(absorption_along_ray=False, steepening_along_ray=False)
    cases = {
        "T1": (*projected, along_axis),
        "T2": (*bowl, ExactOneWay(steepening_along_ray=False)),
        "T3": (*bowl, ExactOneWay()),
    }
    return {
        "version": ax.__version__,
        "jax": jax.__version__,
        "device": str(jax.devices()[0]),
        "settings": settings_of(settings),
        **{name: one_case(name, power, *case, settings, repeats) for name, case in cases.items()},
    }


def settings_of(settings: MarchSettings) -> dict:
    """As plain numbers."""
    return {field.name: getattr(settings, field.name) for field in dataclasses.fields(settings)}


def one_case(name, power, source, drive, diffraction, settings, repeats) -> dict:
    """Times, peaks and errors of one source; the drive is what the compiled function takes."""

    @eqx.filter_jit
    def solve(drive):
        field = solve_field(
            source, drive, layers(), r=np.zeros(1), z=DEPTHS, diffraction=diffraction, settings=settings
        )
        return field.pressure[:, 0], heat_deposition(field)[0]

    drive = jax.tree.map(jnp.asarray, drive)
    start = time.perf_counter()
    pressure, heat = map(np.asarray, jax.block_until_ready(solve(drive)))
    first = time.perf_counter() - start
    cpu_before = time.process_time()
    seconds = [_seconds(solve, drive) for _ in range(repeats)]
    cpu = (time.process_time() - cpu_before) / repeats
    n_times = 32 * len(pressure)
    wave = np.fft.irfft(np.pad(0.5 * n_times * pressure, ((1, 0), (0, 0))), n=n_times, axis=0)
    found = peaks(DEPTHS, wave.max(axis=0), wave.min(axis=0), heat)
    return {
        "first_s": round(first, 3),
        "median_s": round(statistics.median(seconds), 4),
        "min_s": round(min(seconds), 4),
        "mean_cpu_s": round(cpu, 4),
        "repeats": repeats,
        **found,
        "error": errors(found, name, power),
    }


def _seconds(function, *arguments) -> float:
    start = time.perf_counter()
    jax.block_until_ready(function(*arguments))
    return time.perf_counter() - start


def parsed() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--checkout", type=Path, required=True, help="of github.com/jsoneson/HITU_Simulator")
    parser.add_argument("--octave", default="octave-cli")
    parser.add_argument("--power", type=float, default=50.0, help="acoustic power [W]")
    parser.add_argument("--harmonics", type=int, default=128, help="of the other code")
    parser.add_argument("--radial", type=int, default=672, help="radial points of the other code")
    parser.add_argument("--axial", type=int, default=2019, help="axial points of the other code")
    parser.add_argument("--published-steps", type=int, default=5, help="timed with its published loops; 3 or more")
    parser.add_argument("--own-harmonics", type=int, default=SETTINGS.n_harmonics, help="of ours; at 150 W 48")
    parser.add_argument("--repeats", type=int, default=7, help="of ours")
    parser.add_argument("--out", type=Path, required=True)
    return parser.parse_args()


def main() -> None:
    """Measure both and write."""
    given = parsed()
    simulator = Simulator(given.checkout, given.octave)
    jax.config.update("jax_enable_x64", True)
    load = os.getloadavg()[0]
    asked = {"power": given.power, "harmonics": given.harmonics, "n_radial": given.radial, "n_axial": given.axial}
    settings = dataclasses.replace(SETTINGS, n_harmonics=given.own_harmonics)
    ours = run_ours(given.power, settings, given.repeats)
    theirs = run_theirs(simulator, asked, given.published_steps)
    result = {
        "benchmark": "hitu",
        "case": f"five layers, {given.power:g} W",
        "machine": platform.machine(),
        "cpu_count": os.cpu_count(),
        "threads": {name: os.environ.get(name) for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")},
        "load_before": load,
        "load_after": os.getloadavg()[0],
        "HITU_Simulator": theirs,
        "arfjax": ours,
        "times_faster": {
            kind: {case: round(theirs[kind]["seconds"] / ours[case]["median_s"], 1) for case in CASES}
            for kind in ("vectorised", "as published")
        },
        "asked": "150 times faster at equal or better accuracy, against T1, the converged solution of the same physics",
        "equal_or_better": as_good(ours["T1"]["error"], theirs["error"]),
        "times_less_processor": {
            case: round(theirs["vectorised"]["cpu_s"] / ours[case]["mean_cpu_s"], 1) for case in CASES
        },
    }
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(result, indent=2) + "\n")
    print("\n".join(told(result)))


def told(result: dict) -> list[str]:
    """A few lines for the screen."""
    theirs, ours, faster = result["HITU_Simulator"], result["arfjax"], result["times_faster"]
    lines = [
        f"{result['case']}; HITU_Simulator {theirs['commit'][:7]} in {theirs['octave']}",
        f"HITU_Simulator   {theirs['vectorised']['seconds']:9.3f} s, its loops vectorised "
        f"(as published {theirs['as published']['seconds']:.0f} s, from {theirs['as published']['steps_timed']} steps)",
        f"                 {numbers(theirs)}",
    ]
    for case in CASES:
        lines += [
            f"arfjax, {case}       {ours[case]['median_s']:9.4f} s, {faster['vectorised'][case]:.0f} times faster",
            f"                 {numbers(ours[case])}",
        ]
    return lines


def numbers(found: dict) -> str:
    """Peaks and their errors."""
    error = found["error"]
    return ", ".join(
        f"{name} {found[key]:.4g}" + ("" if isinstance(error, str) else f" ({100.0 * error[key]:+.3f} %)")
        for name, key in {"p+": "p_positive_mpa", "p-": "p_negative_mpa", "heat": "heat_w_cm3"}.items()
    )


if __name__ == "__main__":
    main()
