"""The rooms import only downwards, floor by floor, as docs/architecture.md draws them."""

import ast
import builtins
import re
from pathlib import Path

from tests.rooms import (
    FLOOR,
    FOLDERS,
    ROOT,
    SETUPTOOLS,
    arrows,
    imported_modules,
    module_of,
    room_of,
    sources,
)


def test_a_room_imports_only_the_floors_below_it():
    upward = [lines for (room, other), lines in arrows().items() if FLOOR[other] >= FLOOR[room]]
    assert not upward, "\n".join(line for lines in upward for line in lines)


def test_every_module_has_a_room():
    """A new folder in `host/` belongs to none until a floor names it."""
    homeless = [path for path in sources() if room_of(module_of(path)) is None]
    front_door = {ROOT / "host" / "__init__.py", ROOT / "sim" / "__init__.py"}
    assert set(homeless) == front_door


def test_nothing_is_imported_by_a_folder_s_name():
    """`import host` or `import sim` takes whatever folder of that name lies on the path."""
    wrong = []
    for path in (p for top in (*FOLDERS.values(), "tests", "docs") for p in (ROOT / top).rglob("*.py")):
        for module in imported_modules(path, ""):
            if module.split(".")[0] in {"host", "sim", "model_export"}:
                wrong.append(f"{path.relative_to(ROOT)} imports {module}")
    assert not wrong, "\n".join(wrong)


def test_every_package_is_declared():
    """With `package-dir`, setuptools finds none by itself."""
    declared = set(SETUPTOOLS["packages"])
    folders = [ROOT / folder for folder in SETUPTOOLS["package-dir"].values()]
    there = {
        module_of(marker)
        for folder in folders
        for marker in folder.rglob("__init__.py")
        if "node_modules" not in marker.parts
    }
    assert there == declared
    assert {name.partition(".")[0] for name in declared} == {"palpate", "firmware_py"}


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
    for path in sources():
        if room_of(module_of(path)) != "firmware_py" and "device" not in path.parts:
            # on a board there is no such class
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
