"""The rooms import only downwards, as docs/architecture.md says."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ROOMS = ("firmware_py", "sim.tissue", "sim.probe", "model_export", "host")
MAY_IMPORT = {
    "firmware_py": {"firmware_py"},
    "sim.tissue": {"sim.tissue"},
    "sim.probe": {"sim.probe", "sim.tissue", "firmware_py"},
    "model_export": {"model_export", "firmware_py"},
    "host": set(ROOMS),
}


def room_of(module: str) -> str | None:
    return next((room for room in ROOMS if module == room or module.startswith(room + ".")), None)


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


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_imports_only_the_rooms_below_it(room):
    files = [p for p in (ROOT / room.replace(".", "/")).rglob("*.py") if "node_modules" not in p.parts]
    assert files, f"{room} is empty"
    broken = []
    for path in files:
        package = ".".join(path.relative_to(ROOT).parent.parts)
        for module in imported_modules(path, package):
            target = room_of(module)
            if target and target not in MAY_IMPORT[room]:
                broken.append(f"{path.relative_to(ROOT)} imports {module}")
    assert not broken, "\n".join(broken)


def test_firmware_modules_import_each_other_by_the_package_name():
    """The micro:bit has no packages: `from firmware_py.x import y` and relative imports fail there."""
    for path in (ROOT / "firmware_py").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path.name}: relative import"
                assert not (node.module or "").startswith("firmware_py."), f"{path.name}: {node.module}"
