"""Pages of rates hold what their records give."""

import re

import pytest

from benchmarks.diagnosis_docs import _known, _nothing, _strange
from benchmarks.diagnosis_record import ROOT, lines_of
from benchmarks.diagnosis_studies import DMA_STUDY, HMI_STUDY, Study
from benchmarks.diagnosis_summary import summarise


def without_limits(row: str) -> str:
    """A row of a table without what a record does not tell: limits, which are computed from designs."""
    return re.sub(r" \([0-9–]+\)", "", row)


@pytest.mark.parametrize(("study", "record"), [(DMA_STUDY, "diagnosis"), (HMI_STUDY, "diagnosis_hmi")])
def test_rates_on_a_page_are_those_of_its_record(study: Study, record: str):
    summary = summarise(lines_of(ROOT / "benchmarks" / "records" / f"{record}.jsonl"), {})
    page = {without_limits(row) for row in (ROOT / "docs" / study.page).read_text().splitlines()}
    rows = [*_known(summary, ""), *_nothing(summary, study.gated), *_strange(summary, study)]
    rates = [without_limits(row) for row in rows if "±" in row or " of " in row]
    assert len(rates) > 10 and [row for row in rates if row not in page] == []
    assert f"from {summary['data sets']} data sets" in " ".join(page)
