"""Writes firmware_py/package.json, the list that `mpremote mip install` follows.

python -m tests.firmware_py.install_files
"""

import json
from pathlib import Path

FIRMWARE = Path(__file__).parent.parent.parent / "firmware_py"
PACKAGE = FIRMWARE / "package.json"
VERSION = "0.1.0"


def modules() -> list[str]:
    """Every module of the firmware, as a path inside firmware_py."""
    files = [p.relative_to(FIRMWARE).as_posix() for p in FIRMWARE.rglob("*.py")]
    return sorted(f for f in files if f != "manifest.py")


def text() -> str:
    """package.json as it should be: each file goes to lib/firmware_py on the board."""
    urls = [[f"firmware_py/{m}", m] for m in modules()]
    rows = ",\n".join(f"    {json.dumps(row)}" for row in urls)
    return f'{{\n  "urls": [\n{rows}\n  ],\n  "deps": [],\n  "version": "{VERSION}"\n}}\n'


if __name__ == "__main__":
    PACKAGE.write_text(text())
