"""What is studied of the diagnosis, in words, and what is asked of a rate."""

import dataclasses
import math

from inverse.diagnosis import DMA_CAUSES, HMI_CAUSES
from tests.blind import dma_generator, hmi_effects


@dataclasses.dataclass(frozen=True)
class Study:
    """What was studied, in words.

    Attributes:
        name: Of the page and of the figure, without endings.
        title: Of the page.
        command: That makes the page.
        design: One data set.
        kinds: Effects that are in no list.
        remarks: On what the rates rest on.
        data: Where the data sets come from.
        gated: Whether the gate of the noise, which comes after the decision, is in it.
        few: Whether the decision is the one for few data.
        rests: How what a stand-in leaves of an effect without a name was found.
    """

    name: str
    title: str
    command: str
    design: str
    kinds: dict[str, str]
    remarks: tuple[str, ...]
    data: str = "of `tests/blind` "
    gated: bool = False
    few: bool = False
    rests: str = (
        "On one design, without noise: the other cause that imitates it best, refitted in full (constants, strength "
        "and shape), and the d' that it leaves."
    )

    @property
    def page(self) -> str:
        """File of the page."""
        return f"{self.name}.md"

    @property
    def picture(self) -> str:
        """File of the figure."""
        return f"{self.name}.png"


_DMA_HIDDEN = (
    f"Of {len(DMA_CAUSES)} causes {len(dma_generator.shown())} are hidden in turn: the fitted constants imitate "
    "`clamp-compliance`, and `power-law-relaxation` is in the model that is fitted. The rates are of that model, the "
    "fractional one; [another page](operating_characteristic_zener.md) has those of `--model zener`."
)
_ZENER_HIDDEN = (
    f"Of {len(DMA_CAUSES)} causes {len(dma_generator.shown(conventional=True))} are hidden in turn: the fitted "
    "constants imitate `clamp-compliance`. The solids are conventional, with one relaxation time each, in the middle "
    "of the sweep. Tissue of order 0.4 to 0.5 is far from any such solid (a fit leaves a d' of 44 to 50 in 2 % of "
    "noise), where rates near the noise say nothing."
)
_ONE_DESIGN = "All data sets have one design. Others have other limits: see `detectability` in `diagnosis.json`."
_SAME_NUMBERS = (
    "Where what is hidden has a number that the diagnosis fixes, too, the hidden one may be the same: a resonance has "
    "the quality 10 in both, loud noise triples above 40 Hz where the diagnosis looks for noise three times as large "
    "from one of fourteen places on, and of both correlations 0.6 is one of those that it looks for, 0.3 is between "
    "them."
)
_LEFT_OUT = (
    "Rows in which noise makes the loss modulus negative are left out of the files, as one would: in loud noise one or "
    "more in {} of 100."
)
_DETECTION = (
    "How often sets of d' = 4.5 are found is known better from others, on which the test of everything was made alone "
    "(`python -m benchmarks.diagnosis_detection{}`): {} ± {} of 100 of {} sets, where who knows the noise finds {} and "
    "who does not {}."
)
_NOISES = (
    "Noise `tails` has the Student distribution of 4 degrees of freedom, in `correlated-0.3` and `-0.6` neighbours {} "
    "are so correlated, `loud` is three times as large above {}."
)
_DMA_NOISES = (
    _NOISES.format("in frequency (`in-time`: in time, in sweeps of random order)", "40 Hz")
    + " Of `understated` the file has standard deviations, 1.3 times too small. In `unequal` magnitude or phase, by "
    "chance, has four times the noise of the other, of which the file says nothing; limits there are of who knows it."
)
_HMI_NOISES = _NOISES.format("in a sonication", "60 degC")
_NO_GATE = "The gate of the noise comes after this decision: how often it says `noise-model` is not in these rates."
_NO_EFFECT = [c.name for c in HMI_CAUSES if c.name not in (*hmi_effects.EFFECTS, *hmi_effects.UNSEEN)]
_HMI_HIDDEN = (
    f"Of {len(HMI_CAUSES)} causes {len(hmi_effects.EFFECTS)} are hidden in turn. The fitted constants imitate "
    f"{', '.join(hmi_effects.UNSEEN)}, at strengths that there can be, in at least one of the two tissues that were "
    f"tried; {' and '.join(_NO_EFFECT)} have no effect in the generator. How often those are found is not known."
)
DMA_STUDY = Study(
    name="operating_characteristic",
    title="How often the diagnosis of a dynamic mechanical analysis is right",
    command="python -m benchmarks.diagnosis --out benchmarks/records/diagnosis.jsonl --docs docs",
    design="five temperatures, fourteen frequencies, complex modulus, 2 % noise, one hidden effect",
    kinds={
        "bump": "bump at one frequency",
        "smooth": "smooth, common to all sweeps",
        "mains": "one frequency",
        "one-temperature": "one temperature",
    },
    remarks=(
        _DMA_HIDDEN,
        _ONE_DESIGN,
        _DMA_NOISES,
        _SAME_NUMBERS,
        _DETECTION.format("", 91.7, "1.0", 720, 96.1, 93.8),
        _LEFT_OUT.format(35),
        _NO_GATE,
    ),
)
ZENER_STUDY = dataclasses.replace(
    DMA_STUDY,
    name="operating_characteristic_zener",
    title="How often the diagnosis of a dynamic mechanical analysis is right, by the conventional model",
    command="python -m benchmarks.diagnosis --model zener --out benchmarks/records/diagnosis_zener.jsonl --docs docs",
    design="conventional solids, five temperatures, fourteen frequencies, complex modulus, 0.3 % noise, one hidden "
    "effect",
    remarks=(
        _ZENER_HIDDEN,
        _ONE_DESIGN,
        _DMA_NOISES,
        _SAME_NUMBERS,
        _DETECTION.format(" --model zener", 92.6, 0.9, 780, 96.4, 94.6),
        _LEFT_OUT.format(15),
        _NO_GATE,
    ),
)
HMI_STUDY = Study(
    name="operating_characteristic_hmi",
    title="How often the diagnosis of displacement is right",
    command="python -m benchmarks.diagnosis_hmi --out benchmarks/records/diagnosis_hmi.jsonl --docs docs",
    design="three sonications to 63, 73 and 83 degC, read every 2 degC, 1 % noise, one hidden effect, simulated with "
    "the full solid on a mesh and time steps of its own",
    kinds={"bump": "bump at one temperature", "smooth": "smooth along temperature"},
    remarks=(
        _HMI_HIDDEN,
        "Liver is a Zener solid, everywhere as warm as its focus, in the data as in the diagnosis. Curves of tissue "
        "that is fractional and has its own temperature at every point differ from those by 4 to 13 %, in one of six "
        "tissues by 27 %. Constants imitate most of it; a d' of 2 to 7 (in the one about 30) is left in the noise of "
        "these sets, so that such tissue is often called wrong. Tests of it have 3 and 5 % of noise.",
        "All data sets have one design, six tissues, and the temperature that the thermocouple shows as the "
        "coordinate: what changes heating or thermometer shows only through dose and times. See `detectability` in "
        "`diagnosis.json`.",
        _HMI_NOISES,
        "Where what is hidden has a number that the diagnosis fixes, too, the hidden one may be the same: bubbles come "
        "over 2 K, softening over 4 K, and the wire takes 3 s in both.",
        "Intervals count the noise, not what the mesh misses. Without noise 28 of 30 strengths of the round before "
        "(seeds from 2200000) came out within 0.47 standard errors of the noise (0.20 as a root mean square), those of "
        "`perfusion` 0.8 too high and, at d' 6, 2.9 too low (`python -m benchmarks.diagnosis_intervals`): the "
        "likelihood is rough there. The two intervals that miss now are of d' 6, `perfusion` and `thermocouple-lag`. "
        "Of this round and the two before 81 of 87 hold the truth; 95 in 100 are 83.",
        "Noise that is larger than stated, weak effects without a name and many sets without an effect are on [linear "
        "data](operating_characteristic_hmi_linear.md).",
    ),
    gated=True,
    few=True,
)
LINEAR_HMI_STUDY = dataclasses.replace(
    HMI_STUDY,
    name="operating_characteristic_hmi_linear",
    title="How often the decision about displacement is right, on linear data",
    command="python -m benchmarks.diagnosis_hmi_fast --docs docs",
    design="three sonications to 63, 73 and 83 degC, read every 2 degC, 1 % noise, one hidden effect, all of it linear "
    "about three fits to simulated sonications in turn, constants drawn as they are believed. What is asked for is "
    "asked of simulated data; met or not says here what the decision alone does",
    remarks=(
        _HMI_HIDDEN,
        f"{_HMI_NOISES} `understated` is 1.3 times as large as it is weighed by against what is believed. In noise "
        "`-near` constants are drawn with 0.6 of the deviation that is believed, as for blind data.",
        "Causes are looked for and put in along the directions that their effects have about a fit, either sign by "
        "itself: what bends, other meshes, refits and intervals of strengths are not in these rates (`python -m "
        "benchmarks.diagnosis_hmi` has them in its rates, at minutes a data set). Beliefs weigh against the noise that "
        "is found, as in a fit, but in `understated` noise.",
        _NO_GATE,
    ),
    data="",
    gated=False,
    rests="About the three fits, without noise, both signs and many draws: the cause that imitates an effect best (the "
    "one that does so most often), and the d' that it leaves, as a mean. The d' of an effect is by readings alone; "
    "what is believed of constants keeps them from imitating it, so that more than that may be left.",
)


@dataclasses.dataclass(frozen=True)
class Bound:
    """What is asked of a rate in percent.

    Attributes:
        lower: Least that it may be.
        upper: Most that it may be.
    """

    lower: float = 0.0
    upper: float = 100.0

    @property
    def sets(self) -> int:
        """Least number of which one may fail: of fewer nothing is said to be met or not."""
        if not self.lower:
            return math.ceil(100.0 / self.upper)
        sides = [100.0 - side for side in (self.lower, self.upper) if side < 100.0]
        return math.ceil(100.0 / min(sides))

    def met(self, rate: float) -> bool:
        """Whether a rate is within."""
        return self.lower <= rate <= self.upper

    def margin(self, rate: float) -> float:
        """Distance of a rate from the nearest side that is asked for."""
        return min(abs(rate - side) for side in (self.lower, self.upper) if 0.0 < side < 100.0)
