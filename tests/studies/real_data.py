"""What Palpate makes of presses that others have published: python -m tests.studies.real_data FILE.mat"""

import sys
from pathlib import Path

from palpate.console import say, table
from palpate.importing.presses import KINDS, read_mat

DEPTHS_MM = (2, 5, 10, 15, 20)


def main(path: Path) -> None:
    """Print every number of docs/evidence/real-data.md."""
    found = read_mat(path)
    n, depths, taxels, repeats = found.rise.shape
    say(f"{n} places, {found.lump.sum()} with a lump; {depths} depths to {found.depth_mm[-1]:g} mm, "
        f"{taxels} taxels, {repeats} repeats")  # fmt: skip
    for place, number in found.broken:
        say(f"place {place[0]}-{place[1]}, repeat {number}: not a whole press, left out")
    say(f"repeats 2 and 3 differ by {100 * found.repeatability():.1f} % (median over places), "
        f"1 and 2 by {100 * found.repeatability(1, 2):.1f} %")  # fmt: skip
    for low, high in ((1.0, 5.0), (5.0, 20.0)):
        typical, least, most = found.exponent(low, high)
        say(f"reading ~ depth^{typical:.2f} from {low:g} to {high:g} mm ({least:.2f} to {most:.2f})")
    rows = [
        (
            f"{mm}",
            f"{found.told_apart(found.strength(mm)):.2f}",
            f"{found.told_apart(found.unevenness(mm)):.2f}",
        )
        for mm in DEPTHS_MM
    ]
    table(("depth, mm", "by strength", "by unevenness"), rows)
    score = found.unevenness(20)
    order = sorted(range(n), key=lambda k: -score[k])[:6]
    rows = [("-".join(map(str, found.places[k])), f"{score[k]:.3f}", KINDS[found.kinds[k]]) for k in order]
    table(("place", "unevenness", "truth"), rows)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
