"""What Palpate makes of presses that others have published: python -m tests.studies.real_data FILE.mat"""

import sys
from pathlib import Path

import numpy as np

from palpate.console import say, table
from palpate.importing.presses import KINDS, NONE, Floats, Presses, read_mat

DEPTHS_MM = (2, 5, 10, 15, 20)


def repeatability(of: Presses, first: int = 2, other: int = 3) -> float:
    """What two repeats differ by at the greatest depth, as a share of their mean: median over places."""
    a, b = (of.rise.mean(axis=2)[:, -1, n - 1] for n in (first, other))
    return float(np.nanmedian(2 * np.abs(a - b) / (a + b)))


def exponent(of: Presses, low_mm: float, high_mm: float) -> tuple[float, float, float]:
    """The n of reading ~ depth^n between two depths: median over places, least, most."""
    inside = (of.depth_mm >= low_mm) & (of.depth_mm <= high_mm)
    typical = np.nanmedian(of.rise.mean(axis=2), axis=2)[:, inside]
    n = np.array([np.polyfit(np.log(of.depth_mm[inside]), np.log(each), 1)[0] for each in typical])
    return float(np.median(n)), float(n.min()), float(n.max())


def strength_and_unevenness(of: Presses, depth_mm: float) -> tuple[Floats, Floats]:
    """Mean over each place's taxels, of the median repeat; and their standard deviation over it."""
    seen = np.nanmedian(of.rise[:, int(np.abs(of.depth_mm - depth_mm).argmin())], axis=2)
    return seen.mean(axis=1), seen.std(axis=1) / seen.mean(axis=1)


def told_apart(of: Presses, score: Floats) -> float:
    """Share of pairs (a place with a lump, one without) in which the lump scores higher; ties half."""
    lump = np.array(of.kinds) != NONE
    pairs = score[lump][:, None] - score[~lump]
    return float(((pairs > 0) + 0.5 * (pairs == 0)).mean())


def main(path: Path) -> None:
    """Print every number of docs/evidence/real-data.md."""
    found = read_mat(path)
    n, depths, taxels, repeats = found.rise.shape
    lumps = sum(kind != NONE for kind in found.kinds)
    say(f"{n} places, {lumps} with a lump; {depths} depths to {found.depth_mm[-1]:g} mm, "
        f"{taxels} taxels, {repeats} repeats")  # fmt: skip
    for place, number in found.broken:
        say(f"place {place[0]}-{place[1]}, repeat {number}: not a whole press, left out")
    say(f"repeats 2 and 3 differ by {100 * repeatability(found):.1f} % (median over places), "
        f"1 and 2 by {100 * repeatability(found, 1, 2):.1f} %")  # fmt: skip
    for low, high in ((1.0, 5.0), (5.0, 20.0)):
        typical, least, most = exponent(found, low, high)
        say(f"reading ~ depth^{typical:.2f} from {low:g} to {high:g} mm ({least:.2f} to {most:.2f})")
    rows = [
        (f"{mm}", *(f"{told_apart(found, score):.2f}" for score in strength_and_unevenness(found, mm)))
        for mm in DEPTHS_MM
    ]
    table(("depth, mm", "by strength", "by unevenness"), rows)
    _, score = strength_and_unevenness(found, 20)
    order = sorted(range(n), key=lambda k: -score[k])[:6]
    rows = [("-".join(map(str, found.places[k])), f"{score[k]:.3f}", KINDS[found.kinds[k]]) for k in order]
    table(("place", "unevenness", "truth"), rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
