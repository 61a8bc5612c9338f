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
ALIKE = {
    "0b553103b868": {"f870207cdc6b": (800, 800)},
    "f870207cdc6b": {"1ec50ef7b211": (412, 413)},
    "1ec50ef7b211": {"15603ec7c65c": (100, 100)},
    "15603ec7c65c": {"f59545269889": (100, 100)},
    "f59545269889": {"6ab8132ffc32": (100, 100)},
    "6ab8132ffc32": {"daaaf176c535": (100, 100)},
    "daaaf176c535": {"e288a5d17c41": (100, 100)},
    "a9fefaf6bc69": {"81f28894f02e": (9, 14)},
}
"""Code that answered so many data sets, of so many evenly from all of a study, as that before it did
(`benchmarks.diagnosis_again`)."""


def compared() -> dict[str, tuple[str, str]]:
    """Stamp of the code that made each page, and of the code that is here."""
    return {name: (stamp_on((ROOT / "docs" / name).read_text()), stamp(sources)) for name, sources in PAGES.items()}


def alike(made_by: str, here: str) -> tuple[int, int]:
    """How many data sets of how many code answered as other code did; of several changes, the one looked at least."""
    following = ALIKE.get(made_by, {})
    if here in following:
        return following[here]
    chains = [(count, alike(after, here)) for after, count in following.items()]
    found = [min(both, key=lambda one: one[1]) for both in chains if both[1][1]]
    return max(found, key=lambda one: one[1], default=(0, 0))


def said(made_by: str, here: str) -> str:
    """Whether rates of one code are those of another, in words.

    Args:
        made_by: Stamp of the code that made them.
        here: Of the code that is here.
    """
    if made_by == here:
        return "as the code here"
    same, count = alike(made_by, here)
    return f"changed since, to {here}" + (f", which answered {same} of {count} data sets alike" if count else "")


if __name__ == "__main__":
    for name, (made_by, here) in compared().items():
        print(f"docs/{name}: {made_by}, {said(made_by, here)}")
