"""Imports go one way, and what each layer may use is written here."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
GROUND = {"errors", "units", "numerics"}
MATTER = GROUND | {"media", "grid", "coagulation", "laws", "transducer", "suomi2016", "tissues"}
PHYSICS = {"acoustics", "thermal", "mechanics"}
MAY_IMPORT = {
    "errors": set(),
    "units": set(),
    "numerics": GROUND,
    "media": GROUND,
    "grid": GROUND,
    "coagulation": GROUND | {"media"},
    "laws": GROUND | {"media", "coagulation"},
    "transducer": GROUND | {"media"},
    "suomi2016": set(),
    "tissues": MATTER,
    "acoustics": MATTER - {"tissues", "suomi2016"} | {"acoustics"},
    "thermal": MATTER - {"tissues", "suomi2016", "transducer"} | {"thermal"},
    "mechanics": MATTER - {"tissues", "suomi2016", "transducer"} | {"mechanics"},
    "instruments": MATTER - {"tissues", "suomi2016"} | {"thermal", "instruments"},
    "exact": MATTER - {"tissues", "suomi2016"} | {"exact"},
    "model": MATTER | {"mechanics", "thermal"},
    "protocols": MATTER | PHYSICS | {"model", "protocols", "instruments"},
    "experiment": MATTER | PHYSICS | {"model", "protocols", "instruments", "experiment"},
    "io": MATTER | PHYSICS | {"model", "protocols", "instruments"},
    "figures": MATTER | PHYSICS | {"model", "protocols", "instruments", "figures"},
}
"""Modules of arfjax (first name below the package) and those that they may import."""


_OF_A_MEASUREMENT = ("inverse.diagnosis.dma", "inverse.diagnosis.hmi")
"""What the diagnosis of everything does not know; neither knows the other."""


def python_files(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def imported_modules(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.relative_to(ROOT)} has a relative import"
            # `from arfjax import units` imports arfjax.units when there is such a module.
            for alias in node.names:
                below = ROOT / node.module.replace(".", "/") / alias.name
                is_module = below.is_dir() or below.with_suffix(".py").exists()
                names.add(f"{node.module}.{alias.name}" if is_module else node.module)
    return names


def offences() -> list[str]:
    found = []
    for path in python_files("arfjax"):
        place = path.relative_to(ROOT / "arfjax").with_suffix("").parts[0]
        for name in sorted(imported_modules(path)):
            here = path.relative_to(ROOT)
            if name.split(".")[0] == "inverse":
                found.append(f"{here} imports {name}")
            if name.startswith("arfjax.") and place != "__init__" and name.split(".")[1] not in MAY_IMPORT[place]:
                found.append(f"{here} imports {name}")
            if name.startswith("matplotlib") and place != "figures":
                found.append(f"{here} imports {name}")
            if name.startswith("scipy") and place not in {"exact", "numerics"}:
                found.append(f"{here} imports {name}")
    for path in python_files("inverse"):
        for name in sorted(imported_modules(path)):
            here = path.relative_to(ROOT)
            in_commands = "commands" in path.parts
            writing = in_commands or path == ROOT / "inverse" / "output.py"
            drawing = "figures" in path.parts or (writing and name == "matplotlib.figure")
            if name.startswith("matplotlib") and not drawing:
                found.append(f"{here} imports {name}")
            if name.startswith("inverse.commands") and not in_commands:
                found.append(f"{here} imports {name}")
            if name in _OF_A_MEASUREMENT or name.startswith(tuple(f"{one}." for one in _OF_A_MEASUREMENT)):
                own = ".".join(here.parts[:3])
                shared = here.parts[:2] == ("inverse", "diagnosis") and path.name not in ("__init__.py", "choice.py")
                if shared and not f"{name}.".startswith(f"{own}."):
                    found.append(f"{here} imports {name}")
    return found


def test_imports_go_one_way():
    assert offences() == []


@pytest.mark.parametrize("package", ["arfjax", "inverse"])
def test_files_stay_small(package):
    long = [f"{path}: {n}" for path in python_files(package) if (n := len(path.read_text().splitlines())) > 400]
    assert long == []


@pytest.mark.parametrize("package", ["arfjax", "inverse"])
def test_functions_stay_small(package):
    long = []
    for path in python_files(package):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef):
                body = node.body[1:] if ast.get_docstring(node) else node.body
                lines = body[-1].end_lineno - body[0].lineno + 1 if body else 0
                if lines > 80:
                    long.append(f"{path.relative_to(ROOT)}:{node.name}: {lines} lines")
    assert long == []


@pytest.mark.parametrize("package", ["arfjax", "inverse"])
def test_what_is_made_at_run_time_is_compiled_so_that_it_can_be_freed(package):
    """`filter_jit` keeps a closure as long as the process lives: see `arfjax.numerics.compiled`."""
    kept = []
    for path in python_files(package):
        tree = ast.parse(path.read_text())
        decorators = {
            id(one)
            for node in tree.body
            if isinstance(node, ast.FunctionDef)
            for decorator in node.decorator_list
            for one in ast.walk(decorator)
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and node.attr == "filter_jit" and id(node) not in decorators:
                kept.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert kept == []
