"""The rooms of the sources, floor by floor, and the arrows between them: python -m tests.rooms

Writes docs/pictures/rooms.svg and prints how many rooms, floors and arrows there are, and lines of Python and
page outside tests and in them. With --trips: what four calls take to follow (`trips.py`; some minutes).
"""

import ast
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
PICTURE = ROOT / "docs" / "pictures" / "rooms.svg"
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
FLOORS = (
    {
        "firmware_py": ("firmware_py",),
        "ground": tuple(
            f"palpate.{name}"
            for name in ("errors", "files", "console", "progress", "spans", "array", "csv_dialect")
        ),
    },
    {
        "wire": ("palpate.wire",),
        "fixedpoint": ("palpate.fixedpoint",),
        "firmware_twin": ("palpate.firmware_twin",),
        "document": tuple(
            f"palpate.model_export.{name}"
            for name in ("errors", "vocabulary", "model_data", "check", "schema", "integers.reference")
        ),
        "sim.tissue": ("palpate.sim.tissue",),
    },
    {
        "answer": ("palpate.answer",),
        "recording": ("palpate.recording",),
        "features": ("palpate.features",),
        "models": ("palpate.models",),
        "model_export": ("palpate.model_export",),
        "sim.probe": ("palpate.sim.probe",),
    },
    {
        "stroke": ("palpate.stroke",),
        "link": ("palpate.link",),
        "learn": ("palpate.learn", *(f"palpate.models.{name}" for name in ("build", "__main__"))),
    },
    {
        "report": ("palpate.report",),
        "dataset": ("palpate.dataset",),
        "importing": ("palpate.importing",),
        "sources": ("palpate.sources",),
        "inversion": ("palpate.inversion",),
        "characterisation": ("palpate.characterisation",),
        "doctor": tuple(f"palpate.{name}" for name in ("doctor", "first_light", "first_time", "sizes")),
    },
    {
        "view": ("palpate.view",),
        "comparison": ("palpate.comparison",),
        "validation": ("palpate.validation",),
        "adaptation": ("palpate.adaptation",),
        "demo": ("palpate.demo",),
    },
    {"cli": ("palpate.cli", "palpate")},
)
"""From the ground up: room -> its packages and modules. A room imports itself and the floors below."""
FLOOR = {room: number for number, floor in enumerate(FLOORS, 1) for room in floor}
ROOM = {package: room for floor in FLOORS for room, packages in floor.items() for package in packages}
FOLDERS = {**SETUPTOOLS["package-dir"], "palpate.sim": "sim"}
"""What is imported, and where it lies."""


def room_of(module: str) -> str | None:
    """The room of a module, or of a name in it; None of what is not ours, and of the front door."""
    while module and module not in ROOM:
        module = module.rpartition(".")[0]
    return None if module in ("", "palpate") else ROOM[module]


def module_of(path: Path) -> str:
    """What a file is imported as."""
    name, folder = max(
        ((n, f) for n, f in FOLDERS.items() if path.is_relative_to(ROOT / f)), key=lambda pair: len(pair[1])
    )
    parts = path.relative_to(ROOT / folder).with_suffix("").parts
    return ".".join((name, *parts)).removesuffix(".__init__")


def sources() -> list[Path]:
    """Every module of every room."""
    found = {path for folder in FOLDERS.values() for path in (ROOT / folder).rglob("*.py")}
    return sorted(path for path in found if "node_modules" not in path.parts)


def imported_modules(path: Path, package: str) -> Iterator[str]:
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


def arrows() -> dict[tuple[str, str], list[str]]:
    """Which room imports which, and the lines that do."""
    found: dict[tuple[str, str], list[str]] = {}
    for path in sources():
        module = module_of(path)
        room, package = room_of(module) or "cli", module.rpartition(".")[0]
        for target in imported_modules(path, module if path.stem == "__init__" else package):
            other = room_of(target)
            if other is not None and other != room:
                found.setdefault((room, other), []).append(f"{path.relative_to(ROOT)} imports {target}")
    return found


def needed(found: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """The arrows without those that a longer way tells too: a drawing of all of them cannot be read."""

    def reaches(room: str, other: str) -> bool:
        return any(b == other or reaches(b, other) for a, b in found if a == room)

    return {(a, b) for a, b in found if not any(c == a and d != b and reaches(d, b) for c, d in found)}


def lines() -> tuple[int, int]:
    """Lines of Python and of the page (js, css, html) outside tests, and of tests."""
    pages = [
        p for suffix in ("js", "css", "html") for p in (ROOT / "host" / "view" / "page").rglob(f"*.{suffix}")
    ]
    tests = (ROOT / "tests").rglob("*.py")
    outside, inside = (
        sum(len(path.read_bytes().splitlines()) for path in paths) for paths in ([*sources(), *pages], tests)
    )
    return outside, inside


WIDTH, HEIGHT, BOX = 980, 84, (128, 34)


def drawing() -> str:
    """The picture: a row of boxes a floor, the ground at the bottom; arrows from who imports to what."""
    places = {
        room: (60 + (WIDTH - 60) * (k + 0.5) / len(floor), HEIGHT * (len(FLOORS) - n) + HEIGHT / 2)
        for n, floor in enumerate(FLOORS, 1)
        for k, room in enumerate(floor)
    }
    w, h = BOX
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT * len(FLOORS)}" '
        'font-family="sans-serif" font-size="14" text-anchor="middle">',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" '
        'orient="auto"><path d="M0 0 8 4 0 8z" fill="#5a7a78"/></marker></defs>',
        '<rect width="100%" height="100%" fill="#fff"/>',
    ]
    for a, b in sorted(needed(set(arrows()))):
        (x, y), (u, v) = places[a], places[b]
        lines.append(
            f'<path d="M{x:.0f} {y + h / 2:.0f} {u:.0f} {v - h / 2:.0f}" stroke="#5a7a78" fill="none" '
            'marker-end="url(#tip)"/>'
        )
    for room, (x, y) in places.items():
        lines.append(
            f'<rect x="{x - w / 2:.0f}" y="{y - h / 2:.0f}" width="{w}" height="{h}" rx="5" fill="#e4f1f0" '
            'stroke="#00796b"/>'
        )
        lines.append(f'<text x="{x:.0f}" y="{y + 5:.0f}" fill="#123">{room}</text>')
    for n in range(1, len(FLOORS) + 1):
        y = HEIGHT * (len(FLOORS) - n) + HEIGHT / 2 + 5
        lines.append(f'<text x="20" y="{y:.0f}" fill="#678">{n}</text>')
    return "\n".join([*lines, "</svg>", ""])


def main() -> None:
    """Draw and count."""
    PICTURE.write_text(drawing(), encoding="utf-8")
    found = arrows()
    upward = sum(FLOOR[b] >= FLOOR[a] for a, b in found)
    print(f"{len(FLOOR)} rooms on {len(FLOORS)} floors, {len(found)} arrows, {upward} of them upward")
    outside, inside = lines()
    print(f"{outside:,} lines of Python and page outside tests, {inside:,} in tests")


if __name__ == "__main__":
    if "--trips" in sys.argv:
        from tests import trips

        trips.main()
    else:
        main()
