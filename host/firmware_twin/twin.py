"""The firmware's own source, loaded a second time with its functions wrapped: compiled, or checked.

The probe's files hold plain loops over arrays and integers, so numba can compile them as they stand
(`replay_core`), and a test can watch every intermediate number. Nothing is written twice.
"""

from __future__ import annotations

import ast
import importlib
import sys
import types
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

# leaf first
STAGES = (
    "fixed",
    "calib",
    "bins",
    "stuck",
    "traces",
    "search",
    "gauss",
    "gaussfit",
    "columns",
    "forcemap",
    "profile",
    "features",
    "press",
    "feature_chain",
    "pipeline",
)

Wrap = Callable[[types.FunctionType], Any]
Rewrite = Callable[[ast.Module], ast.Module]


def source_of(name: str) -> Path:
    """Where the firmware module of this name lies."""
    module = importlib.import_module(f"firmware_py.{name}")
    return Path(str(module.__file__))


def plain() -> types.SimpleNamespace:
    """The firmware's modules as they are."""
    return types.SimpleNamespace(**{name: importlib.import_module(f"firmware_py.{name}") for name in STAGES})


def load(
    stages: Iterable[str] = STAGES,
    *,
    label: str,
    wrap: Wrap | None = None,
    rewrite: Rewrite | None = None,
    names: dict[str, Any] | None = None,
) -> types.SimpleNamespace:
    """Load firmware modules a second time, so that they see one another's wrapped functions.

    Parameters
    ----------
    stages : iterable of str
        Module names, leaf first. What they import beyond these stays the ordinary module.
    label : str
        Tells this twin from others in `sys.modules`.
    wrap : callable, optional
        Takes each module-level function, returns what stands in its place.
    rewrite : callable, optional
        Takes and returns each module's syntax tree.
    names : dict, optional
        Put into every module's namespace beforehand.

    Returns
    -------
    SimpleNamespace of the modules by name.
    """
    twins: dict[str, types.ModuleType] = {}
    for name in stages:
        path = source_of(name)
        tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
        module = types.ModuleType(f"palpate_{label}_{name}")
        module.__dict__.update(names or {})
        module.__file__ = str(path)
        body: list[ast.stmt] = []
        for node in tree.body:
            if isinstance(node, ast.ImportFrom) and node.module == "firmware_py":
                for alias in node.names:
                    other = twins.get(alias.name) or importlib.import_module(f"firmware_py.{alias.name}")
                    setattr(module, alias.asname or alias.name, other)
            elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("firmware_py."):
                source = str(node.module)
                owner = twins.get(source.removeprefix("firmware_py.")) or importlib.import_module(source)
                for alias in node.names:
                    setattr(module, alias.asname or alias.name, getattr(owner, alias.name))
            else:
                body.append(node)
        tree.body = body
        if rewrite is not None:
            tree = ast.fix_missing_locations(rewrite(tree))
        # numba's cache looks a module up by its name
        sys.modules[module.__name__] = module
        exec(compile(tree, str(path), "exec"), module.__dict__)
        if wrap is not None:
            for key, value in list(module.__dict__.items()):
                if isinstance(value, types.FunctionType) and value.__module__ == module.__name__:
                    setattr(module, key, wrap(value))
        twins[name] = module
    return types.SimpleNamespace(**twins)
