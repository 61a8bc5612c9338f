"""The second study: displacement of whole liver over stiffness and attenuation, and what its two averages imply.

The paper gives neither the power nor the average values of the literature, only the displacements there: 9 and 6 um.
What can be said without them are ratios, and the power that would give 9 um at assumed averages.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Float

from arfjax import Model, StepwiseProtocol, displacement_map, suomi2016
from arfjax.protocols.discretisation import Discretisation
from arfjax.units import from_db_per_cm
from inverse.reproduction.bench import Bench
from inverse.reproduction.row import Row

SECTION = "second study"
POINTS = (151, 121)
"""Steps of 1 kPa and of 0.01 dB/cm."""

TABLE_ATTENUATION = suomi2016.TABLE_1_ACOUSTIC["liver"].attenuation_db_per_cm_mhz
"""Of table 1 [dB/cm at 1 MHz]: the one value of fresh liver that the paper states."""

ASSUMED_MODULI_KPA = (5.0, 10.0, 20.0)
"""Fresh liver's modulus [kPa] for which the rows are given; the paper shows its average in a figure only."""


_NO_CHANGE = 1.0
"""What "did not result in changes" is taken to allow [percent]; ours."""


@dataclasses.dataclass(frozen=True)
class SecondStudy:
    """Displacement over both axes.

    Attributes:
        modulus_kpa: M_inf - M_0.
        attenuation_db_per_cm: Of liver at 1 MHz.
        displacement_per_watt: At the geometric focus at the end of the push [m/W], linear sound.
    """

    modulus_kpa: Float[np.ndarray, " modulus"]
    attenuation_db_per_cm: Float[np.ndarray, " attenuation"]
    displacement_per_watt: Float[np.ndarray, "modulus attenuation"]

    def dataset(self) -> xr.Dataset:
        """The map with units."""
        dataset = xr.Dataset(
            {
                "displacement_per_watt": (
                    ("branch_modulus", "attenuation"),
                    self.displacement_per_watt,
                    {"units": "m W-1", "long_name": "focal displacement at the end of a push per acoustic power"},
                )
            },
            coords={
                "branch_modulus": (
                    "branch_modulus",
                    1e3 * self.modulus_kpa,
                    {"units": "Pa", "long_name": "M_inf - M_0 of liver"},
                ),
                "attenuation": (
                    "attenuation",
                    from_db_per_cm(1.0) * self.attenuation_db_per_cm,
                    {"units": "m-1", "long_name": "attenuation of liver at 1 MHz [Np/m]"},
                ),
            },
        )
        dataset.attrs |= {
            "relaxed_modulus_pa": suomi2016.SECOND_STUDY_RELAXED_MODULUS_PA,
            "relaxation_time_s": suomi2016.SECOND_STUDY_RELAXATION_TIME,
        }
        return dataset

    def at(self, modulus_kpa: float, attenuation_db_per_cm: float) -> float:
        """Displacement [m/W] between the points: bilinear in the logarithms of displacement and modulus."""
        logarithm = np.log(self.displacement_per_watt)
        along = [np.interp(attenuation_db_per_cm, self.attenuation_db_per_cm, row) for row in logarithm]
        return float(np.exp(np.interp(np.log(modulus_kpa), np.log(self.modulus_kpa), along)))

    def ratio(self, modulus_kpa: float, factor: float, attenuation_db_per_cm: float = TABLE_ATTENUATION) -> float:
        """Displacement after over before ablation, which multiplies the modulus by a factor and attenuation by 2.1.

        Args:
            modulus_kpa: Before.
            factor: On the modulus.
            attenuation_db_per_cm: Before.
        """
        after = self.at(factor * modulus_kpa, suomi2016.TEXT_ABLATION_ATTENUATION_RATIO * attenuation_db_per_cm)
        return after / self.at(modulus_kpa, attenuation_db_per_cm)

    def factor_for(self, ratio: float, modulus_kpa: float) -> float:
        """Factor on the modulus that gives a ratio, from the attenuation of table 1; NaN if none on the map does."""
        factors = np.geomspace(1.0, self.modulus_kpa[-1] / modulus_kpa, 400)
        ratios = np.asarray([self.ratio(modulus_kpa, float(factor)) for factor in factors])
        return float(np.interp(-ratio, -ratios, factors, left=np.nan, right=np.nan))

    def power_for(self, displacement: float, modulus_kpa: float) -> float:
        """Acoustic power [W] that gives a displacement [m] at a modulus and the attenuation of table 1."""
        return displacement / self.at(modulus_kpa, TABLE_ATTENUATION)


def run_second_study(
    model: Model, protocol: StepwiseProtocol, settings: Discretisation, *, points: tuple[int, int] = POINTS
) -> SecondStudy:
    """The map over the paper's two ranges.

    Args:
        model: The experiment's.
        protocol: Which says how long the push is.
        settings: Discretisation with linear sound.
        points: Numbers of moduli and of attenuations.
    """
    modulus = np.linspace(*suomi2016.SECOND_STUDY_MODULUS_KPA, points[0])
    attenuation = np.linspace(*suomi2016.SECOND_STUDY_ATTENUATION_DB_PER_CM, points[1])
    one_watt = dataclasses.replace(model, drive=dataclasses.replace(model.drive, acoustic_power=1.0))
    displacement = jax.jit(
        lambda moduli, alphas: displacement_map(
            one_watt,
            moduli,
            alphas,
            protocol,
            settings,
            relaxed_modulus=suomi2016.SECOND_STUDY_RELAXED_MODULUS_PA,
            relaxation_time=suomi2016.SECOND_STUDY_RELAXATION_TIME,
        )
    )(1e3 * modulus, from_db_per_cm(1.0) * attenuation)
    return SecondStudy(modulus, attenuation, np.asarray(displacement))


def second_study_rows(study: SecondStudy) -> list[Row]:
    """Ratios of the two averages, what would give the paper's, and the power of 9 um."""
    before, after = suomi2016.SECOND_STUDY_UNABLATED_UM, suomi2016.SECOND_STUDY_ABLATED_UM
    stated, rows = after / before, []
    # 9 and 6 um are rounded to a micrometre.
    tolerance = max((after + 0.5) / (before - 0.5) - stated, stated - (after - 0.5) / (before + 0.5))
    ablated = suomi2016.TEXT_ABLATION_ATTENUATION_RATIO * TABLE_ATTENUATION
    change = f"attenuation {TABLE_ATTENUATION:g} to {ablated:.3g} dB/cm"
    for modulus in ASSUMED_MODULI_KPA:
        for factor in suomi2016.TEXT_ABLATION_MODULUS_RATIO:
            if factor * modulus > study.modulus_kpa[-1]:
                continue  # beyond the paper's range
            quantity = f"displacement after over before ablation, modulus {modulus:g} to {factor * modulus:g} kPa"
            why = f"{change}; 'E four-fold to eight-fold' and '+110 percent' by the text, {modulus:g} kPa assumed"
            rows.append(Row(SECTION, quantity, stated, study.ratio(modulus, factor), "1", tolerance, why))
    for modulus in ASSUMED_MODULI_KPA:
        factor = study.factor_for(stated, modulus)
        quantity = f"factor on the modulus that gives 6 from 9 um, from {modulus:g} kPa"
        low, high = suomi2016.TEXT_ABLATION_MODULUS_RATIO
        why = f"{change}; the literature's factor is {low:g} to {high:g}"
        rows.append(Row(SECTION, quantity, 0.5 * (low + high), factor, "1", 0.5 * (high - low), why))
    for modulus in ASSUMED_MODULI_KPA:
        power = study.power_for(1e-6 * before, modulus)
        quantity = f"acoustic power that gives 9 um at {modulus:g} kPa, {TABLE_ATTENUATION:g} dB/cm"
        why = "linear sound; the paper states no power, intensity or pressure of its simulation"
        rows.append(Row(SECTION, quantity, None, power, "W", 0.0, why))
    return rows


def insensitivity(bench: Bench, modulus_kpa: float) -> dict[str, float]:
    """Change of the displacement [percent] when M_0 or tau goes through the values of table 2, M_inf - M_0 held.

    Keys: "M_0" from the smallest to the largest of the conventional rows, "tau" likewise.
    """
    rows = suomi2016.TABLE_2_ZENER.values()
    relaxed = [row.relaxed_modulus_pa for row in rows]
    times = [row.relaxation_time for row in rows]
    force = bench.linear(bench.protocol.start_temperature).force

    def displacement(relaxed_modulus: float, time: float) -> float:
        return float(jnp.vdot(bench.homogeneous_response(1e3 * modulus_kpa, relaxed_modulus, time), force))

    usual = (suomi2016.SECOND_STUDY_RELAXED_MODULUS_PA, suomi2016.SECOND_STUDY_RELAXATION_TIME)
    return {
        "M_0": 100.0 * (displacement(max(relaxed), usual[1]) / displacement(min(relaxed), usual[1]) - 1.0),
        "tau": 100.0 * (displacement(usual[0], max(times)) / displacement(usual[0], min(times)) - 1.0),
    }


def insensitivity_rows(bench: Bench) -> list[Row]:
    """'Varying M_0 and tau ... did not result in changes ... due to the overpowering effect of M_inf'."""
    rows = []
    for modulus in suomi2016.SECOND_STUDY_MODULUS_KPA:
        changes = insensitivity(bench, modulus)
        for name, change in changes.items():
            why = (
                "smallest to largest of table 2. A branch that relaxes in 35 to 932 ms is still there at 0.5 ms"
                if name == "tau"
                else "8 to 1351 Pa. M_0 adds to the stiffness at 0.5 ms, with M_inf - M_0 held as the axis has it"
            )
            quantity = f"change of the displacement with {name}, M_inf - M_0 = {modulus:g} kPa"
            rows.append(Row(SECTION, quantity, 0.0, change, "percent", _NO_CHANGE, why))
    return rows
