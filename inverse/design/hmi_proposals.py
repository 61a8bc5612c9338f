"""Sonications that one could make next, beside those whose displacement has been measured."""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from arfjax import SineIntensity, Square, StepwiseProtocol
from arfjax.experiment.file import PUSH_MODULATIONS, PUSHES_MS, SONICATIONS_S

COAGULATION = (48.0, 60.0)
"""Between which liver coagulates in a sonication of a minute or so [degC]."""
_BELOW_COAGULATION = 50.0
_HOTTER = 8.0
_HOTTEST = 90.0
_LEAST_RISE = 5.0
THERMOCOUPLE, TRACKING = "instruments: thermocouple", "instruments: tracking"
"""Places of causes that another instrument does not have."""


@dataclasses.dataclass(frozen=True)
class HmiProposal:
    """One more sonication.

    Attributes:
        name: Short.
        words: What to do.
        protocol: Of the sonication.
        temperature: Of each reading, ascending from the reference [degC].
        immune: Places of causes that cannot reach it.
    """

    name: str
    words: str
    protocol: StepwiseProtocol
    temperature: Float[np.ndarray, " row"]
    immune: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Number of readings."""
        return len(self.temperature)

    @property
    def seconds(self) -> float:
        """How long it takes [s]."""
        return self.protocol.duration

    @property
    def keys(self) -> dict[str, float | str]:
        """What `[protocol]` says of it in an experiment file."""
        (modulation,) = (name for name, each in PUSH_MODULATIONS.items() if each == self.protocol.modulation)
        return {
            "sonication_s": self.protocol.duration,
            # As a person would write it: 0.45, not 0.45000000000000007.
            "push_ms": float(f"{1e3 * self.protocol.push_duration:.12g}"),
            "push_modulation": modulation,
        }


def hmi_proposals(
    protocol: StepwiseProtocol, *, reference: float, hottest: float, readings: int
) -> tuple[HmiProposal, ...]:
    """One sonication each, all with as many readings: another end, pace, push, place of the readings, or instrument.

    Pushes of constant force vary in length and in course, those that are modulated already in length alone.

    Args:
        protocol: Of the sonications that were made.
        reference: Temperature of the first reading [degC].
        hottest: That was reached in any [degC].
        readings: In each.
    """

    def one(name: str, words: str, final: float = hottest, *, immune: tuple[str, ...] = (), **changed) -> HmiProposal:
        return HmiProposal(name, words, dataclasses.replace(protocol, final_temperature=final, **changed),
                           np.linspace(reference, final, readings), immune)  # fmt: skip

    usual = protocol.duration
    found = [one("again", f"one more sonication to {hottest:.0f} degC")]
    for pace, factor in (("slower", 2.0), ("faster", 0.5)):
        if SONICATIONS_S[0] <= factor * usual <= SONICATIONS_S[1]:
            words = f"a sonication to {hottest:.0f} degC in {factor * usual:.4g} s instead of {usual:.4g}"
            found.append(one(pace, words, duration=factor * usual))
    found += [
        *_other_pushes(one, protocol),
        one("mr-thermometry", "one more sonication with magnetic resonance thermometry instead of the thermocouple",
            immune=(THERMOCOUPLE,)),
        one("mr-displacement", "one more sonication with displacement by magnetic resonance instead of ultrasound",
            immune=(TRACKING,)),
    ]  # fmt: skip
    if hottest + _HOTTER <= _HOTTEST:
        found.append(one("hotter", f"a sonication to {hottest + _HOTTER:.0f} degC", hottest + _HOTTER))
    if reference + _LEAST_RISE < _BELOW_COAGULATION < hottest - _LEAST_RISE:
        found.append(one("not-coagulating", f"a sonication that ends at {_BELOW_COAGULATION:.0f} degC",
                         _BELOW_COAGULATION))  # fmt: skip
    low, high = max(COAGULATION[0], reference), min(COAGULATION[1], hottest)
    before = [reference] if reference < low else []
    if high - low > _LEAST_RISE and readings - len(before) > 1:
        words = f"a sonication that ends at {high:.0f} degC, read from {low:.0f} degC on only"
        dense = np.append(before, np.linspace(low, high, readings - len(before)))
        found.append(dataclasses.replace(one("around-coagulation", words, high), temperature=dense))
    return tuple(found)


def _other_pushes(one: Callable[..., HmiProposal], protocol: StepwiseProtocol) -> list[HmiProposal]:
    """With pushes of another length, and of another course if that is constant: those have the usual one's impulse."""
    constant, push = protocol.modulation is None, protocol.push_duration
    pushes, usual = "pushes of" if constant else "pushes whose course takes", f"{1e3 * push:.4g}"
    words = f"{pushes} {0.5e3 * push:.4g} ms instead of {usual}"
    found = [one("shorter-push", words, push_duration=0.5 * push)] if 0.5e3 * push >= PUSHES_MS[0] else []
    if 2e3 * push > PUSHES_MS[1]:
        return found
    twice = f"{pushes} {2e3 * push:.4g} ms"
    found.append(one("longer-push", f"{twice} instead of {usual}", push_duration=2.0 * push))
    if constant:
        words = f"{twice} whose force rises and falls as one period of a sine, instead of {usual} ms of constant force"
        found.append(one("modulated-push", words, push_duration=2.0 * push, modulation=SineIntensity()))
        words = f"displacement read {0.5e3 * push:.4g} ms after the end of the push instead of at it"
        found.append(one("later-reading", words, push_duration=2.0 * push, modulation=Square()))
    return found
