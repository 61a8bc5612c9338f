"""What makes a fast simulation agree with the full one about a fit, in value and derivatives.

Source: Alexandrov & Lewis, Optim. Eng. 2 (2001) 413: first-order consistent additive correction.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int


@dataclasses.dataclass(frozen=True)
class Correction:
    """The difference of two simulations, to first order in some unknowns.

    Attributes:
        about: Unknowns at which it was taken.
        value: There.
        moved: Places of the unknowns in which its derivatives are known; it does not change with the others.
        columns: These derivatives.
    """

    about: Float[np.ndarray, " unknown"]
    value: Float[np.ndarray, " row"]
    moved: Int[np.ndarray, " moved"]
    columns: Float[np.ndarray, "row moved"]

    @property
    def is_finite(self) -> bool:
        """Whether both simulations could be made."""
        return bool(np.all(np.isfinite(self.value)) and np.all(np.isfinite(self.columns)))

    def __call__(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " row"]:
        """At other unknowns."""
        return self.value + self.columns @ (unknowns - self.about)[self.moved]

    def slopes(self, which: Sequence[int]) -> Float[np.ndarray, "row which"]:
        """Derivative in some of the unknowns."""
        found = np.zeros((len(self.value), len(which)))
        for column, place in enumerate(which):
            known = np.flatnonzero(self.moved == place)
            found[:, column] = np.sum(self.columns[:, known], axis=1)
        return found
