"""The front door: `from palpate import ...`, whatever else lies on the path, and what a wheel installs."""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import palpate

ROOT = Path(__file__).parent.parent
NAMES = {
    "Case", "EmulatedProbe", "PalpateError", "Probe", "export", "fit", "invert", "open_recording", "simulate",
    "sweep",
}  # fmt: skip
GIT_FILES = ["git", "ls-files", "-zco", "--exclude-standard"]
"""What is committed, and what is about to be."""
NPM = ("sim/probe/wasm/node_modules", "host/view/fonts/node_modules")
"""What set-up installs there goes into a wheel as well."""
HEAVY = "click matplotlib mcap numba numpy pandas rich scipy serial skfem statsmodels"


def python(*arguments, path: Path | None = None, cwd: Path | None = None, **variables: str) -> str:
    """What a fresh interpreter prints; `path` comes first where it looks for modules."""
    environment = os.environ | variables | ({} if path is None else {"PYTHONPATH": str(path)})
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True, text=True, check=False, env=environment, cwd=cwd,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_every_name_of_the_door_opens():
    assert set(palpate.__all__) == NAMES <= set(dir(palpate))
    for name in NAMES:
        assert getattr(palpate, name).__module__.startswith("palpate.")
    with pytest.raises(AttributeError, match="no attribute 'Caes'"):
        palpate.Caes  # noqa: B018


def test_the_door_itself_imports_nothing():
    """Each name's home is imported when the name is first used."""
    loaded = f"import sys, palpate; print([m for m in '{HEAVY}'.split() if m in sys.modules])"
    assert python("-c", loaded) == "[]"


def test_modules_of_one_s_own_do_no_harm(tmp_path):
    """With a `sim/` or a `host.py` beside one's work `palpate --version` crashed, when we had these names."""
    for name in ("host", "sim", "model_export", "tests"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('the wrong module')\n")
    assert python("-m", "palpate.cli", "--version", path=tmp_path, cwd=tmp_path).startswith("palpate ")
    opened = python("-c", "from palpate import simulate, fit, Probe; print(1)", path=tmp_path, cwd=tmp_path)
    assert opened == "1"


def copy_of_the_repository(place: Path) -> Path:
    """The files that git knows, as a fresh clone has them."""
    listed = subprocess.run(GIT_FILES, cwd=ROOT, capture_output=True, check=True).stdout
    for name in filter(None, listed.decode().split("\0")):
        if (ROOT / name).exists():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, place / name)
    return place


@pytest.fixture(scope="module")
def sdist(tmp_path_factory) -> Path:
    """An sdist of the files that git knows, and of what set-up installs among them."""
    source = copy_of_the_repository(tmp_path_factory.mktemp("sdist") / "source")
    for folder in NPM:
        shutil.copytree(ROOT / folder, source / folder)
    build = "import setuptools.build_meta as b; print(b.build_sdist('dist'))"
    return source / "dist" / python("-c", build, cwd=source).splitlines()[-1]


@pytest.fixture(scope="module")
def wheel(sdist, tmp_path_factory) -> zipfile.ZipFile:
    """Built from the sdist alone: no index, no npm."""
    place = tmp_path_factory.mktemp("wheel")
    for name in ("npm", "node"):
        (place / name).write_text("#!/bin/sh\nexit 1\n")
        (place / name).chmod(0o755)
    pip = ["-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "--no-index"]
    python(*pip, "--wheel-dir", place, sdist, PATH=f"{place}:{os.environ['PATH']}")
    (built,) = place.glob("palpate-*.whl")
    return zipfile.ZipFile(built)


@pytest.mark.long
def test_a_fresh_clone_builds_by_itself(wheel, tmp_path):
    """`pip install .` asked for `make setup`. Now the build asks npm, in an environment that pip makes."""
    source = copy_of_the_repository(tmp_path / "source")
    python("-m", "pip", "wheel", "-q", "--no-deps", "--wheel-dir", tmp_path, source)
    (built,) = tmp_path.glob("palpate-*.whl")
    assert sorted(zipfile.ZipFile(built).namelist()) == sorted(wheel.namelist())


def test_a_wheel_carries_the_examples_and_no_page_of_the_documentation(wheel):
    there = {name for name in wheel.namelist() if name.startswith("palpate/examples/")}
    assert {"palpate/examples/one_stroke.py", "palpate/examples/foreign_world.npz"} <= there
    assert "palpate/examples/c/client.c" in there and not [name for name in there if name.endswith(".md")]


def test_what_a_package_index_would_show_has_no_link_into_nowhere(wheel):
    """README's links lead to files of the repository; the index does not have these."""
    (name,) = (name for name in wheel.namelist() if name.endswith("METADATA"))
    head, _, text = wheel.read(name).decode().partition("\n\n")
    assert f"Version: {palpate.__version__}\n" in head and "Classifier: Topic :: Scientific" in head
    assert "# Palpate" in text and "docs/" not in text
    assert not [target for target in re.findall(r"\]\(([^)]*)\)", text) if "://" not in target]


def test_a_wheel_takes_two_names_and_no_other(wheel):
    tops = {name.split("/")[0] for name in wheel.namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"palpate", "firmware_py"}


def test_a_wheel_holds_every_file_of_the_rooms(wheel):
    """Code, the page, the WASM runner, the report's template, the manifest: all that git knows there."""
    homes = {"host": "palpate", "sim": "palpate/sim", "model_export": "palpate/model_export"}
    homes["firmware_py"] = "firmware_py"
    rooms_of_their_own = {"palpate/model_export/fixedpoint/": "palpate/fixedpoint/"}
    inside = set(wheel.namelist())
    listed = subprocess.run([*GIT_FILES, *homes], cwd=ROOT, capture_output=True, check=True)
    files = [Path(name) for name in filter(None, listed.stdout.decode().split("\0"))]
    npm = {f.parent for f in files if f.name == "package-lock.json"}
    wanted = [
        f for f in files
        if (ROOT / f).exists()
        and not f.name.startswith(".")
        and not (f.parent in npm and f.name in ("package.json", "package-lock.json"))
    ]  # fmt: skip
    places = {f: "/".join((homes[f.parts[0]], *f.parts[1:])) for f in wanted}
    for inner, own in rooms_of_their_own.items():
        places = {f: place.replace(inner, own) for f, place in places.items()}
    assert not [f for f, place in places.items() if place not in inside]


def test_an_unpacked_wheel_runs_without_the_repository(wheel, tmp_path):
    """The emulated probe is the longest way through it: firmware, runner and link are all found inside."""
    wheel.extractall(tmp_path / "site")
    code = (
        "import firmware_py, palpate\n"
        f"assert palpate.__file__.startswith({str(tmp_path)!r}), palpate.__file__\n"
        f"assert firmware_py.__file__.startswith({str(tmp_path)!r}), firmware_py.__file__\n"
        "with palpate.EmulatedProbe('cpython') as device, palpate.Probe.open(device.port) as probe:\n"
        "    print(probe.identity.protocol)\n"
    )
    assert python("-c", code, path=tmp_path / "site", cwd=tmp_path).isdigit()
    assert python("-m", "palpate.cli", "--help", path=tmp_path / "site", cwd=tmp_path).startswith("Usage")
