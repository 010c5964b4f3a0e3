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
    found = {"OUTPUTS": n, "_VALUES": 3 * n, "PREDICTED": 3 * n, "WORK": 4 * n}
    found |= {"FLAGS": 3 * n, "DISTANCE": 3 * n + 1, "LEVEL": 3 * n + 2, "OUT_SIZE": 3 * n + 3}
    found |= {"FORCE": 3 * force, "E_OUTPUT": e, "E_LOW": 3 * e + 1, "E_HIGH": 3 * e + 2}
    return {name: str(number) for name, number in found.items()} | {
        "SIGMA_DOWN": str(BITS * n),
        "ALIKE": "0x" + n * "1",
        "ALL_DOWNS": "0x" + n * "F",
    }


def one_by_one(n):
    """The body of polynomial.sums that names every output."""
    each = range(n)
    lines = ["    " + " = ".join(f"{word}{j}" for j in each) + " = 0" for word in "ab"]
    lines += [
        "    i = at",
        "    for k in range(first, last):",
        "        h = steps[k]",
        "        v = part[h]",
        "        h = high[h]",
    ]
    for j in each:
        lines += [f"        a{j} += c[i] * v", f"        b{j} += d[i] * h", "        i += 1"]
    lines += [f"    a{j} += b{j} >> low_sum_shift" for j in each]
    lines += ["    if downs:"]
    lines += [f"        a{j} >>= downs{f' >> {BITS * j}' if j else ''} & 15" for j in each]
    lines += [f"    work[to{f' + {j}' if j else ''}] += a{j}" for j in each]
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
            before, rest = text.split("    a0 = a1", 1)
            text = before + one_by_one(outputs.COUNT) + "\n\ndef carry(" + rest.split("\n\ndef carry(", 1)[1]
        texts[path] = text
    return texts


if __name__ == "__main__":
    for path, text in written().items():
        path.write_text(text, encoding="utf-8")
