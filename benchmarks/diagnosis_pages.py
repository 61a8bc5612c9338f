"""Which of the pages of rates are of the code that is here.

python -m benchmarks.diagnosis_pages
"""

from benchmarks import diagnosis, diagnosis_hmi
from benchmarks.diagnosis_record import ROOT, stamp, stamp_on

PAGES = {
    "operating_characteristic.md": diagnosis.SOURCES,
    "operating_characteristic_zener.md": diagnosis.SOURCES,
    "operating_characteristic_hmi.md": diagnosis_hmi.SOURCES,
    "operating_characteristic_hmi_linear.md": diagnosis_hmi.SOURCES,
}
"""Code that each depends on."""
ALIKE = {"0b553103b868": {"f870207cdc6b": 800}}
"""Code that answered so many data sets of records, evenly from all, as its own did (`benchmarks.diagnosis_again`):
changed in what no answer to these depends on."""


def compared() -> dict[str, tuple[str, str]]:
    """Stamp of the code that made each page, and of the code that is here."""
    return {name: (stamp_on((ROOT / "docs" / name).read_text()), stamp(sources)) for name, sources in PAGES.items()}


def said(made_by: str, here: str) -> str:
    """Whether rates of one code are those of another, in words.

    Args:
        made_by: Stamp of the code that made them.
        here: Of the code that is here.
    """
    if made_by == here:
        return "as the code here"
    alike = ALIKE.get(made_by, {}).get(here)
    return f"changed since, to {here}" + (f", which answered {alike} of its data sets alike" if alike else "")


if __name__ == "__main__":
    for name, (made_by, here) in compared().items():
        print(f"docs/{name}: {made_by}, {said(made_by, here)}")
