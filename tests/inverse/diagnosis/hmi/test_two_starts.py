"""Of fits from two starts the one that converged is used, and what is said of them is so."""

from types import SimpleNamespace

import numpy as np
import pytest

from inverse.diagnosis.hmi import diagnosis
from inverse.diagnosis.hmi.fitting import HmiFit
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from tests.inverse.diagnosis.hmi.cases import bare


class _Rows:
    deviation = np.ones(4)

    def __len__(self):
        return 4


@pytest.mark.parametrize(
    ("first", "second", "used", "said"),
    [
        ((10.0, True), (10.0, True), 0, ""),
        ((10.0, True), (5.0, True), 1, "the better one is used"),
        ((5.0, True), (10.0, True), 0, "the better one is used"),
        ((10.0, True), (5.0, False), 0, "the better one did not converge"),
        ((5.0, False), (10.0, True), 1, "the better one did not converge"),
        ((5.0, False), (10.0, False), 0, "the better one is used"),
    ],
)
def test_which_is_used(monkeypatch, first, second, used, said):
    program = SimpleNamespace(null=lambda: np.zeros(3), start=np.zeros(2), constants=slice(0, 2), spreads=np.ones(2))
    problem = bare(HmiDiagnosisProblem, noise_family=lambda: [None], rows=_Rows(), program=program)
    fits = [bare(HmiFit, misfit=m, converged=c, problem=problem, unknowns=None) for m, c in (first, second)]
    monkeypatch.setattr(diagnosis, "fit_hmi", lambda *_, start=None, **__: fits[0 if start is None else 1])
    monkeypatch.setattr(diagnosis, "fit_remarks", lambda _: ())
    monkeypatch.setattr(diagnosis, "_beside_effect", lambda null, _, size, __: (null, size, ()))
    found, _, remarks = diagnosis._fitted(problem, (), False, 0, lambda _: None)
    assert found is fits[used]
    assert (said in remarks[0]) if said else remarks == ()
