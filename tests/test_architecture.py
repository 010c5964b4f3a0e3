"""The rooms import only downwards, as docs/architecture.md says."""

import ast
import builtins
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FOLDERS = {
    "firmware_py": "firmware_py",
    "palpate.sim.tissue": "sim/tissue",
    "palpate.sim.probe": "sim/probe",
    "palpate.model_export": "model_export",
    "palpate.errors": "host/errors.py",
    "palpate.files": "host/files.py",
    "palpate": "host",
}
"""What is imported, and where it lies."""
MAY_IMPORT = {
    "firmware_py": {"firmware_py"},
    "palpate.errors": set(),
    "palpate.files": {"palpate.errors"},
    "palpate.sim.tissue": {"palpate.sim.tissue", "palpate.errors"},
    "palpate.sim.probe": {"palpate.sim.probe", "palpate.sim.tissue", "palpate.errors", "firmware_py"},
    "palpate.model_export": {"palpate.model_export", "palpate.errors", "palpate.files", "firmware_py"},
    "palpate": set(FOLDERS),
}
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]


def room_of(module: str) -> str | None:
    return next((room for room in FOLDERS if module == room or module.startswith(room + ".")), None)


def files_of(room: str) -> list[Path]:
    top = ROOT / FOLDERS[room]
    found = [top] if top.suffix else sorted(top.rglob("*.py"))
    return [path for path in found if "node_modules" not in path.parts]


def imported_modules(path: Path, package: str):
    """Every module named in an import, relative ones made absolute."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*parts, base] if base else parts)
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("room", FOLDERS)
def test_a_room_imports_only_the_rooms_below_it(room):
    files = files_of(room)
    assert files, f"{room} is empty"
    broken = []
    for path in files:
        package = ".".join(path.relative_to(ROOT).parent.parts)
        for module in imported_modules(path, package):
            target = room_of(module)
            if target and target not in MAY_IMPORT[room]:
                broken.append(f"{path.relative_to(ROOT)} imports {module}")
    assert not broken, "\n".join(broken)


def test_nothing_is_imported_by_a_folder_s_name():
    """`import host` or `import sim` takes whatever folder of that name lies on the path."""
    wrong = []
    for path in (p for top in (*set(FOLDERS.values()), "tests", "docs") for p in (ROOT / top).rglob("*.py")):
        for module in imported_modules(path, ""):
            if module.split(".")[0] in {"host", "sim", "model_export"}:
                wrong.append(f"{path.relative_to(ROOT)} imports {module}")
    assert not wrong, "\n".join(wrong)


def test_every_package_is_declared():
    """With `package-dir`, setuptools finds none by itself."""
    declared = set(SETUPTOOLS["packages"])
    there = set()
    for name, folder in SETUPTOOLS["package-dir"].items():
        for marker in (ROOT / folder).rglob("__init__.py"):
            if "node_modules" not in marker.parts:
                there.add(".".join((name, *marker.parent.relative_to(ROOT / folder).parts)))
    assert there == declared
    assert {name.partition(".")[0] for name in declared} == {"palpate", "firmware_py"}


def test_firmware_modules_import_each_other_by_the_package_name():
    """The micro:bit has no packages: `from firmware_py.x import y` and relative imports fail there."""
    for path in (ROOT / "firmware_py").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path.name}: relative import"
                assert not (node.module or "").startswith("firmware_py."), f"{path.name}: {node.module}"


HARDWARE = {"debug_port.py", "machine_code.py", "microbit.py", "mpy_file.py", "pico.py", "pio.py"}
"""They stand for chips and interpreters, and raise what these raise."""


def builtin_errors(path: Path):
    """Lines that raise one of Python's own errors with a text: such a text is meant for a user."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Raise) and isinstance(call := node.exc, ast.Call) and call.args:
            kind = getattr(builtins, getattr(call.func, "id", ""), None)
            if isinstance(kind, type) and issubclass(kind, Exception) and kind is not AttributeError:
                yield node.lineno


def test_what_is_raised_on_purpose_has_one_root():
    """The command line knows errors with a sentence for the user by `PalpateError`, and by nothing else."""
    wrong = []
    for room in FOLDERS:
        if room != "firmware_py":  # on a board there is no such class
            for path in (p for p in files_of(room) if p.name not in HARDWARE and "device" not in p.parts):
                wrong += [f"{path.relative_to(ROOT)}:{line}" for line in builtin_errors(path)]
    assert not wrong, wrong


TOPS = "(?:docs|firmware_py|host|model_export|sim|tests)"


def test_every_place_that_the_architecture_names_is_there():
    """Paths, and the names in them: `firmware_py/features.py`: `NAMES` must be found by who looks for it."""
    text = (ROOT / "docs" / "architecture.md").read_text()
    gone = [path for path in re.findall(rf"`({TOPS}/[\w./-]*)`", text) if not (ROOT / path).exists()]
    for path, names in re.findall(rf"`({TOPS}/[\w/]+\.py)`: ((?:`\w+`(?:, | and )?)+)", text):
        source = (ROOT / path).read_text()
        gone += [
            f"{path}: {name}"
            for name in re.findall(r"`(\w+)`", names)
            if not re.search(rf"\b{name}\b", source)
        ]
    assert not gone
