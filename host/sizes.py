"""What each package that Palpate brings takes on the disk."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


@dataclass(frozen=True)
class Size:
    """An installed package, its megabytes (10^6 bytes, without byte code), and what asks for it."""

    name: str
    MB: float
    asked_by: str


def sizes(root: str = "palpate") -> list[Size]:
    """Every installed package that `root` needs, with its extras, largest first; without `root` itself.

    A package that only an extra asks for is listed under it, as `palpate[hdf5]`.
    """
    found: dict[str, Size] = {}
    waiting = sorted(_needs(distribution(root), root), key=lambda pair: "[" in pair[1])  # extras last
    while waiting:
        need, by = waiting.pop(0)
        key = canonicalize_name(need.name)
        if key in found or key == canonicalize_name(root):
            continue
        try:
            package = distribution(need.name)
        except PackageNotFoundError:
            continue
        found[key] = Size(need.name, _megabytes(package), by)
        inner = [(n, need.name if by == root else by) for n, _ in _needs(package, need.name, need.extras)]
        waiting[0:0] = inner
    return sorted(found.values(), key=lambda size: -size.MB)


def _needs(
    package: Distribution, name: str, extras: set[str] | None = None
) -> Iterator[tuple[Requirement, str]]:
    """What a package asks for here; of the extras all, or those named."""
    known = package.metadata.get_all("Provides-Extra") or []
    chosen = known if extras is None else sorted(extras)
    for text in package.requires or ():
        need = Requirement(text)
        if need.marker is None or need.marker.evaluate({"extra": ""}):
            yield need, name
            continue
        extra = next((e for e in chosen if need.marker.evaluate({"extra": e})), None)
        if extra is not None:
            yield need, f"{name}[{extra}]"


def _megabytes(package: Distribution) -> float:
    files = (Path(str(file.locate())) for file in package.files or () if "__pycache__" not in file.parts)
    return sum(path.stat().st_size for path in files if path.is_file()) / 1e6
