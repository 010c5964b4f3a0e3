"""Numbers of the table of outputs that loops hold as they are: python -m tests.firmware_py.output_numbers

The boards' compiler puts in only what a module says of itself in plain numbers (constant.py), and the
evaluator's innermost loop goes over the outputs without a loop of its own. This writes both from
firmware_py/outputs.py; a test holds them to be what it would write.
"""

import re
from pathlib import Path

from firmware_py import outputs

FIRMWARE = Path(str(outputs.__file__)).parent
BITS = 4  # for how far an output's sums are shifted down
MOST = 6  # outputs: their bits and ln sigma's are one number below 2^30


def numbers(n, force, e):
    """Name -> number, as it is written, for n outputs of which these are the force and E^-2/3."""
    found = {"OUTPUTS": n, "_VALUES": 3 * n, "SIGMAS": 3 * n, "WORK": 4 * n}
    found |= {"FLAGS": 3 * n, "DISTANCE": 3 * n + 1, "LEVEL": 3 * n + 2, "OUT_SIZE": 3 * n + 3}
    found |= {"FORCE": 3 * force, "E_OUTPUT": e, "E_LOW": 3 * e + 1, "E_HIGH": 3 * e + 2}
    return {name: str(number) for name, number in found.items()} | {
        "SIGMA_DOWN": str(BITS * n),
        "ALIKE": "0x" + n * "1",
        "ALL_DOWNS": "0x" + n * "F",
    }


def one_by_one(n):
    """The end of polynomial.nested, which names every output."""
    each = range(n)
    lines = ["        " + " = ".join(f"{word}{j}" for j in each) + " = 0" for word in "ab"]
    lines += [
        "        while i < end:",
        "            h = steps[i]",
        "            v = part[h]",
        "            h = high[h]",
        "            i += 1",
    ]
    for j in each:
        lines += [f"            a{j} += c[at] * v", f"            b{j} += d[at] * h", "            at += 1"]
    for j in each:
        place, down = (f" + {j}", f" >> {BITS * j}") if j else ("", "")
        lines += [f"        work[to{place}] += a{j} + (b{j} >> low_sum_shift) >> (downs{down} & 15)"]
    return "\n".join(lines) + "\n"


def written():
    """Path -> text of the modules that hold such numbers."""
    assert outputs.COUNT <= MOST, f"the evaluator has room for {MOST} outputs, not {outputs.COUNT}"
    found = numbers(outputs.COUNT, outputs.NAMES.index("F_N_per_m"), outputs.E_INV23)
    texts = {}
    for name in ("evaluator", "polynomial", "verdict"):
        path = FIRMWARE / f"{name}.py"
        text = path.read_text(encoding="utf-8")
        for known, number in found.items():
            text = re.sub(rf"^{known} = const\(\w+\)", f"{known} = const({number})", text, flags=re.MULTILINE)
        if name == "polynomial":
            before, rest = text.split("        a0 = a1", 1)
            rest = rest.split("\n\ndef dot_high(", 1)[1]
            text = before + one_by_one(outputs.COUNT) + "\n\ndef dot_high(" + rest
        texts[path] = text
    return texts


if __name__ == "__main__":
    for path, text in written().items():
        path.write_text(text, encoding="utf-8")
