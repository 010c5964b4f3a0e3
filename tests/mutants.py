"""Faults put into the source one at a time, by cosmic-ray: which of them do the tests notice?

    python -m tests.mutants [MODULE ...] [--sample 25 | --all] [--seed palpate] [--jobs 1] [--write | --again]

Each mutant is one change (an operator, a number, a comparison, a call left out; in numerical kernels a
result that is 1 % off). It runs in a copy of the tree; killed is what fails a test or takes far too long.
`tests/mutants.toml` says which tests a module's mutants must get past, `tests/survivors.toml` why those
that got past stand. `--write` keeps the figures for docs/reliability.md; `--again` tries only what got past
in the sample kept there.
"""

from __future__ import annotations

import argparse
import ast
import concurrent.futures
import datetime
import functools
import json
import os
import queue
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cosmic_ray.plugins
import parso
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator

ROOT = Path(__file__).parent.parent
HERE = Path(__file__).parent
CONFIG: dict[str, dict[str, Any]] = tomllib.loads((HERE / "mutants.toml").read_text())
FIGURES = ROOT / "docs" / "evidence" / "mutants.json"
PYTEST = ("-x", "-q", "-o", "addopts=", "-m", "not long", "-p", "no:cacheprovider")
WANTED = 0.9
# no mutants of a kind that is always, or nearly always, equivalent, or that a linter finds
LEFT_OUT = re.compile(r"core/(.*_(Is|IsNot)|Replace.*Operator_Is.*|ExceptionReplacer|Variable.*)$")
COPIED_IN = """
import sys
from importlib.util import spec_from_file_location
from pathlib import Path

FOLDERS = {folders!r}

class Copied:
    "Imports what is ours from the copy, not from where it is installed."
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name in FOLDERS:
            folder = Path(FOLDERS[name])
            return spec_from_file_location(
                name, folder / "__init__.py", submodule_search_locations=[str(folder)])

sys.meta_path.insert(0, Copied)
"""
WARM = """
import json, os, signal, sys, time
import hypothesis, numba, numpy, pandas, pytest, scipy.optimize, scipy.sparse.linalg, scipy.stats  # not ours
sys.path.insert(0, os.getcwd())
for line in sys.stdin:
    limit_s, words = json.loads(line)
    child = os.fork()
    if not child:
        os.setsid()
        null = os.open(os.devnull, os.O_RDWR)
        for k in range(3):
            os.dup2(null, k)
        os._exit(pytest.main(words))
    end, code = time.monotonic() + limit_s, None
    while code is None and time.monotonic() < end:
        time.sleep(0.05)
        done, how = os.waitpid(child, os.WNOHANG)
        code = os.waitstatus_to_exitcode(how) if done else None
    try:
        os.killpg(child, signal.SIGKILL)
    except ProcessLookupError:
        pass
    if code is None:
        os.waitpid(child, 0)
    print(json.dumps(code), flush=True)
"""
"""Runs tests in a process of its own each, with what others wrote imported already: half the time."""
Mutant = dict[str, Any]


class CallLeftOut(Operator):
    """A call whose value nobody takes is left out."""

    def mutation_positions(self, node: Any) -> Iterator[tuple[Any, Any]]:
        if node.type == "atom_expr" and node.parent.type in ("simple_stmt", "suite", "file_input"):
            last = node.children[-1]
            if last.type == "trailer" and last.children[0].value == "(":
                yield node.start_pos, node.end_pos

    def mutate(self, node: Any, index: int) -> Any:
        return parso.python.tree.Keyword("None", node.start_pos, prefix=node.get_first_leaf().prefix)

    @classmethod
    def examples(cls) -> tuple[()]:
        return ()


class OnePercent(Operator):
    """What is assigned, added or returned is 1 % too large; not what serves as an index or a length."""

    def mutation_positions(self, node: Any) -> Iterator[tuple[Any, Any]]:
        if node.type == "expr_stmt" and len(node.children) == 3 and node.children[2].type in SUMS:
            name = node.children[0].get_first_leaf().value
            if node.children[0].type == "atom_expr" or name not in _indices(node.get_root_node()):
                yield node.children[2].start_pos, node.children[2].end_pos

    def mutate(self, node: Any, index: int) -> Any:
        code = f" (1.01 * ({node.children[2].get_code().strip()}))"
        node.children[2] = parso.parse(code).children[0]
        return node

    @classmethod
    def examples(cls) -> tuple[()]:
        return ()


SUMS = ("term", "arith_expr", "power", "factor")


@functools.lru_cache(maxsize=2)  # as the module was before the fault: halfway through one it is no Python
def _indices(tree: Any) -> set[str]:
    """Names that stand in an index, a range or a shape somewhere in the module."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(tree.get_code())):
        inner: list[ast.AST] = []
        if isinstance(node, ast.Subscript):
            inner = [node.slice]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "range":
            inner = list(node.args)
        found |= {leaf.id for one in inner for leaf in ast.walk(one) if isinstance(leaf, ast.Name)}
    return found


def operators(config: dict[str, Any]) -> dict[str, Operator]:
    """The kinds of faults that a module gets, by name."""
    if config.get("faults") == "one percent":
        return {"OnePercent": OnePercent()}
    names = [name for name in cosmic_ray.plugins.operator_names() if not LEFT_OUT.match(name)]
    return {"CallLeftOut": CallLeftOut(), **{n: cosmic_ray.plugins.get_operator(n)() for n in names}}


def mutants(module: str, sample: int | None, seed: str) -> list[Mutant]:
    """Places in a module with a fault each, as `seed` draws them; without `sample` every fault there is."""
    source = (ROOT / module).read_text()
    annotations = list(_annotations(source))
    tree = get_ast(source)
    places: dict[Any, list[tuple[str, int]]] = {}
    for name, operator in operators(CONFIG[module]).items():
        spots = (spot for node in ast_nodes(tree) for spot in operator.mutation_positions(node))
        for occurrence, (start, end) in enumerate(spots):
            if not any(a <= start and end <= b for a, b in annotations):
                places.setdefault((start, end), []).append((name, occurrence))
    chance = random.Random(f"{seed} {module}")
    if sample is None:
        chosen = [fault for faults in places.values() for fault in faults]
    else:
        drawn = chance.sample(sorted(places), min(sample, len(places)))
        chosen = [chance.choice(places[place]) for place in sorted(drawn)]
    return [{"module": module, "operator": name, "occurrence": k} for name, k in chosen]


def texts(mutant: Mutant) -> tuple[str, str]:
    """The module without its fault and with it."""
    source = (ROOT / mutant["module"]).read_text()
    operator = operators(CONFIG[mutant["module"]])[mutant["operator"]]
    return source, mutate_code(source, operator, mutant["occurrence"])


def lines_of(source: str, changed: str) -> Mutant:
    """The first line that a fault has changed: its number, as it was and as it is."""
    lines = zip(source.splitlines(), changed.splitlines())
    number, (was, now) = next((k, pair) for k, pair in enumerate(lines, 1) if pair[0] != pair[1])
    return {"line": number, "was": was.strip(), "now": now.strip()}


def _annotations(source: str) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """Where types stand, and what makes a class one of data: nothing runs there."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ClassDef):
            for part in node.decorator_list:
                yield (part.lineno, 0), (part.end_lineno or 0, part.end_col_offset or 0)
        for field in ("annotation", "returns"):
            part = getattr(node, field, None)
            if isinstance(part, ast.expr) and part.end_lineno and part.end_col_offset is not None:
                yield (part.lineno, part.col_offset), (part.end_lineno, part.end_col_offset)


class Copy:
    """The tree once more, where a fault does no harm; runs tests there."""

    def __init__(self, parent: Path, number: int) -> None:
        self.root = parent / str(number) / "tree"
        shutil.copytree(ROOT, self.root, symlinks=True, ignore=_beside)
        for modules in ROOT.glob("*/*/*/node_modules"):  # the runtime's and the page's: linked, not copied
            (self.root / modules.relative_to(ROOT)).symlink_to(modules)
        folders = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-dir"]
        place = parent / str(number) / "first"
        place.mkdir()
        (place / "sitecustomize.py").write_text(
            COPIED_IN.format(folders={name: str(self.root / folder) for name, folder in folders.items()})
        )
        (place / "warm.py").write_text(WARM)
        self.warm = subprocess.Popen(
            [sys.executable, "-m", "warm"], cwd=self.root, env={**os.environ, "PYTHONPATH": str(place)},
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def passes(self, tests: list[str], limit_s: float) -> bool | None:
        """Whether all tests pass; None where they took too long."""
        assert self.warm.stdin and self.warm.stdout
        self.warm.stdin.write(json.dumps([limit_s, [*PYTEST, *tests]]) + "\n")
        self.warm.stdin.flush()
        code = json.loads(self.warm.stdout.readline())
        return None if code is None else code == 0

    def try_out(self, mutant: Mutant, limit_s: float) -> Mutant:
        """The mutant with its lines and what became of it."""
        path = self.root / mutant["module"]
        source, changed = texts(mutant)
        began = time.monotonic()
        self.forget_compiled(mutant["module"])
        path.write_text(changed)
        try:
            passed = self.passes(CONFIG[mutant["module"]]["tests"], limit_s)
        finally:
            path.write_text(source)
            self.forget_compiled(mutant["module"])
        seconds = round(time.monotonic() - began, 1)
        return {
            **mutant, **lines_of(source, changed),
            "killed": not passed, "late": passed is None, "seconds": seconds,
        }  # fmt: skip

    def forget_compiled(self, module: str) -> None:
        """Python knows its byte code by size and second; numba knows no file but a function's own."""
        path = self.root / module
        for kept in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
            kept.unlink()
        if CONFIG[module].get("faults") != "one percent":
            return
        stale, found = {Path(module).stem}, set[str]()
        folder = self.root / "sim" / "tissue"
        while stale - found:
            found |= stale
            uses = re.compile(rf"^(from|import) .*\b({'|'.join(found)})\b", re.MULTILINE)
            stale |= {path.stem for path in folder.rglob("*.py") if uses.search(path.read_text())}
        for kept in folder.rglob("*.nbi"):
            if kept.name.partition(".")[0] in found:
                kept.unlink()


def _beside(folder: str, names: list[str]) -> set[str]:
    left = {".git", ".venv", ".links", "node_modules", "build", "dist", "site", "out", ".mypy_cache"}
    return left & set(names)


def run_campaign(drawn: dict[str, list[Mutant]], jobs: int, keep: Callable[..., None]) -> list[Mutant]:
    """Try mutants out, module by module, on `jobs` copies; says each survivor as it is found."""
    done: list[Mutant] = []
    with tempfile.TemporaryDirectory() as place, concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        copies: queue.Queue[Copy] = queue.Queue()
        for copy in pool.map(lambda k: Copy(Path(place), k), range(jobs)):
            copies.put(copy)

        def borrow(work: Callable[[Copy], Any]) -> Any:
            copy = copies.get()
            try:
                return work(copy)
            finally:
                copies.put(copy)

        for module, faults in drawn.items():
            began = time.monotonic()
            if not borrow(lambda copy, module=module: copy.passes(CONFIG[module]["tests"], 1800)):
                raise SystemExit(f"{module}: its tests fail without a fault")
            limit_s = 3 * (time.monotonic() - began) + CONFIG[module].get("more_s", 20)
            tried = [
                pool.submit(borrow, lambda copy, m=m, limit_s=limit_s: copy.try_out(m, limit_s))
                for m in faults
            ]
            for future in concurrent.futures.as_completed(tried):
                one = future.result()
                done.append(one)
                if not one["killed"]:
                    print(f"survived {module}:{one['line']}: {one['was']}  ->  {one['now']}", flush=True)
            print(f"{module}: {share(done, module)}", flush=True)
            keep(module, [one for one in done if one["module"] == module])
    return done


def reasons() -> dict[tuple[str, str, str], dict[str, str]]:
    """Survivors that are known, by module and lines, with their reasons."""
    known = tomllib.loads((HERE / "survivors.toml").read_text())["survivor"]
    return {(one["module"], one["was"], one["now"]): one for one in known}


def share(done: list[Mutant], module: str = "") -> str:
    """How many of a module's mutants, or of all, were killed."""
    killed, others, equivalent = count(done, module)
    text = f"{killed} of {killed + others} killed ({killed / max(1, killed + others):.0%})"
    return text + (f", {equivalent} equivalent" if equivalent else "")


def count(done: list[Mutant], module: str = "") -> tuple[int, int, int]:
    """Killed, survivors, and among those that passed the equivalents, which count for neither."""
    known = reasons()
    mine = [one for one in done if module in ("", one["module"])]
    passed = [one for one in mine if not one["killed"]]
    same = [one for one in passed if "equivalent" in known.get(key(one), {})]
    return len(mine) - len(passed), len(passed) - len(same), len(same)


def key(one: Mutant) -> tuple[str, str, str]:
    """What tells a mutant from others, wherever its line has gone."""
    return one["module"], one["was"], one["now"]


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("modules", nargs="*", help="paths, as in tests/mutants.toml; all by default")
    parser.add_argument("--sample", type=int, default=25, help="mutants a module (25)")
    parser.add_argument("--all", action="store_true", help="every mutant there is: hours")
    parser.add_argument("--seed", default="palpate", help="another draws other mutants (palpate)")
    parser.add_argument("--jobs", type=int, default=1, help="copies that work side by side (1)")
    parser.add_argument("--write", action="store_true", help=f"keep the figures in {FIGURES.name}")
    parser.add_argument("--again", action="store_true", help="only what got past in the sample that is kept")
    wish = parser.parse_args()
    kept = json.loads(FIGURES.read_text()) if FIGURES.exists() else {}
    modules = wish.modules or [name for name in CONFIG if name in kept or not wish.again]
    if wish.again:
        drawn = {name: past(name, kept[name]) for name in modules}
    else:
        sample = None if wish.all else wish.sample
        drawn = {name: mutants(name, sample, wish.seed) for name in modules}

    def keep(module: str, tried: list[Mutant]) -> None:
        passed = sorted(key(one)[1:] for one in tried if not one["killed"])
        if wish.again:
            kept[module]["survivors"] = passed
        elif wish.write:
            kept[module] = {
                "seed": wish.seed, "sample": None if wish.all else wish.sample, "tried": len(tried),
                "date": f"{datetime.date.today()}", "at_first": passed, "survivors": passed,
            }  # fmt: skip
        FIGURES.write_text(json.dumps(kept, indent=1, sort_keys=True) + "\n")

    for name in [name for name in modules if wish.again and not drawn[name]]:
        keep(name, [])  # none got past, or the line is no more
    tried = {name: faults for name, faults in drawn.items() if faults}
    done = run_campaign(tried, wish.jobs, keep) if tried else []
    killed, others, _ = count(done)
    print(f"in all: {share(done)}")
    strange = [one for one in done if not one["killed"] and key(one) not in reasons()]
    if strange:
        print(f"{len(strange)} survivors without a reason in tests/survivors.toml")
    sys.exit((killed < WANTED * (killed + others) and not wish.again) or bool(strange))


def past(module: str, kept: dict[str, Any]) -> list[Mutant]:
    """The mutants of the sample that is kept which nobody noticed; of a line changed since there are none."""
    survivors = {tuple(pair) for pair in kept["survivors"]}
    drawn = [(one, lines_of(*texts(one))) for one in mutants(module, kept["sample"], kept["seed"])]
    return [one for one, lines in drawn if (lines["was"], lines["now"]) in survivors]


if __name__ == "__main__":
    main()
