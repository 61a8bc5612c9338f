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


def compared() -> dict[str, tuple[str, str]]:
    """Stamp of the code that made each page, and of the code that is here."""
    return {name: (stamp_on((ROOT / "docs" / name).read_text()), stamp(sources)) for name, sources in PAGES.items()}


if __name__ == "__main__":
    for name, (made_by, here) in compared().items():
        print(f"docs/{name}: {made_by}, {'as the code here' if made_by == here else f'changed since, to {here}'}")
