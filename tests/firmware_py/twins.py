"""The firmware's machine code in the place of its plain loops, on an emulated processor."""

import ast
import importlib
import sys
from array import array
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

from firmware_py import crc
from tests.micropython import FIRMWARE
from tests.sim.probe.machine_code import MachineCode

HOT = FIRMWARE / "hot_viper.py"
STROKE = FIRMWARE / "stroke_viper.py"
EVALUATOR = FIRMWARE / "evaluator_viper.py"
LINK = FIRMWARE / "boards" / "fast_link.py"
SHA = FIRMWARE / "sha_thumb.py"
SCAN = FIRMWARE / "boards" / "fast_scan.py"


def places(source: Path) -> dict[str, tuple[str, str]]:
    """Which function `install` puts where: its name -> module of firmware_py, attribute."""
    found = {}
    for node in ast.walk(ast.parse(source.read_text())):
        if isinstance(node, ast.FunctionDef) and node.name == "install":
            for line in node.body:
                if isinstance(line, ast.Assign):
                    (target,) = line.targets
                    assert isinstance(target, ast.Attribute)
                    assert isinstance(target.value, ast.Name)
                    assert isinstance(line.value, ast.Name)
                    found[line.value.id] = target.value.id, target.attr
    return found


def executed(
    source: Path, viper: Callable[[Any], Any], change=lambda tree: tree, **names: Any
) -> dict[str, Any]:
    """A twin's names, its viper functions being what `viper` makes of them; `names` are there beforehand."""
    tree = ast.parse(source.read_text())
    tree.body = [
        node
        for node in tree.body
        if not (isinstance(node, ast.Import) and node.names[0].name == "micropython")
    ]
    space = {
        "micropython": SimpleNamespace(viper=viper),
        **dict.fromkeys(("ptr8", "ptr16", "ptr32")),
        **names,
    }
    exec(compile(ast.fix_missing_locations(change(tree)), str(source), "exec"), space)
    return space


@contextmanager
def installed(source: Path, code: MachineCode) -> Iterator[dict[str, int]]:
    """What `install` does, for as long as this lasts; gives how often each function was called."""
    calls: dict[str, int] = {}
    before = []
    space = executed(source, lambda function: code[function.__name__])

    def counted(name):
        function = space[name]
        calls[name] = 0

        def call(*arguments):
            calls[name] += 1
            return function(*arguments)

        return call

    for name, (module_name, attribute) in places(source).items():
        module = importlib.import_module(f"firmware_py.{module_name}")
        before.append((module, attribute, getattr(module, attribute)))
        setattr(module, attribute, counted(name))
    try:
        yield calls
    finally:
        for module, attribute, plain in before:
            setattr(module, attribute, plain)


def hash_of_nodes(code: Mapping[str, Callable], monkeypatch: Any) -> ModuleType:
    """The module sha_thumb as a board has it, its function in inline assembler being that of `code`."""
    micropython = ModuleType("micropython")
    micropython.asm_thumb = lambda function: code[function.__name__]  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "micropython", micropython)
    module = ModuleType("sha_thumb")
    exec(compile(SHA.read_text(), str(SHA), "exec"), module.__dict__)
    return module


def half_byte_tables() -> tuple["array[int]", "array[int]"]:
    """The tables that the link's checksum goes by."""
    low, high = (array("H", [table[i] for i in range(0, 256, 16)]) for table in (crc._LOW, crc._HIGH))
    return low, high
