"""A compiled regression: its proof, its errors, its integers in numpy, and its sources."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.fixedpoint import data, mpy, sources
from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.intervals import LIMIT, Proof
from palpate.fixedpoint.ir import Code
from palpate.fixedpoint.space import Array, Feature

if TYPE_CHECKING:
    from palpate.fixedpoint.assembly import Model
    from palpate.fixedpoint.calibration import Calibration

TRIED = 5_000
"""Vectors of the box over which errors are told."""
AT_ONCE = 50_000


@dataclass(frozen=True)
class Output:
    """An integer that comes out: `out[k]` times `step` is in `unit`s; `lo` to `hi` is all that it can be."""

    name: str
    unit: str
    step: float
    lo: int = 0
    hi: int = 0


@dataclass(frozen=True)
class Error:
    """What the integers add to an output, in its unit, over n vectors; `spread` is its standard deviation."""

    name: str
    over: str
    n: int
    worst: float
    rms: float
    spread: float

    def __str__(self) -> str:
        return (
            f"{self.name} over {self.over} (n = {self.n}): worst {self.worst:.2e}, rms {self.rms:.2e} "
            f"({self.rms / (self.spread or 1.0):.1e} of its standard deviation)"
        )


@dataclass(frozen=True)
class Program:
    """What `compile`, `from_sklearn` and `from_statsmodels` give.

    Attributes
    ----------
    features : tuple of Feature
        What goes in: integers of their steps, in this order.
    outputs : tuple of Output
        What comes out, `out[0]`, `out[1]`, ..
    classes : tuple
        Of a classifier: what an integer of its last output, `verdict`, means.
    code : ir.Code
    proof : Proof
        Every intermediate within 31 bits, whatever the features; the narrowest margin, and where it is.
    model : assembly.Model
        What was compiled, in float64.
    sample : array (n, features), or None
        The data that it is for.
    calibration : Calibration, or None
    """

    features: tuple[Feature, ...]
    outputs: tuple[Output, ...]
    classes: tuple[Any, ...]
    code: Code = field(repr=False)
    proof: Proof
    model: Model = field(repr=False)
    sample: Array | None = field(repr=False, default=None)
    calibration: Calibration | None = field(repr=False, default=None)

    def quantised(self, X: Any) -> Array:
        """Features (n x features, in their units) as the device is given them: int64."""
        return self.model.space.whole(self._table(X))

    def _table(self, X: Any) -> Array:
        columns = getattr(X, "columns", None)
        if columns is not None:
            missing = [f.name for f in self.features if f.name not in columns]
            if missing:
                raise CompileError(f"the data have no column {missing[0]!r}; they have {', '.join(columns)}")
            X = X[[f.name for f in self.features]]
        table = np.atleast_2d(data.numbers(X, "features"))
        if table.shape[1] != len(self.features):
            raise CompileError(f"the program takes {len(self.features)} features, not {table.shape[1]}")
        if not np.isfinite(table).all():
            row, column = np.argwhere(~np.isfinite(table))[0]
            raise CompileError(f"row {row} has no finite {self.features[column].name}")
        return table

    def predict(self, X: Any) -> Array:
        """The integers of `out`, n x outputs, for features X, n x features in their units: the device's."""
        x = self.quantised(X)
        parts = [self.code.run(x[at : at + AT_ONCE], len(self.outputs)) for at in range(0, len(x), AT_ONCE)]
        return np.vstack(parts) if parts else np.zeros((0, len(self.outputs)), np.int64)

    def values(self, X: Any) -> Array:
        """The same in the outputs' units."""
        return self.predict(X) * np.array([o.step for o in self.outputs])

    def box(self, n: int, seed: int = 1) -> Array:
        """n random vectors of the box, and its corners, up to as many."""
        lo, hi = (np.array([getattr(f, end) for f in self.features]) for end in ("lo", "hi"))
        steps = np.array([f.step for f in self.features])
        ends = itertools.islice(itertools.product((0, 1), repeat=len(lo)), max(n, 2))
        corners = np.where(np.array(list(ends)), hi, lo)
        return np.vstack([self.model.space.random(np.random.default_rng(seed), n), corners]) * steps

    @cached_property
    def errors(self) -> tuple[Error, ...]:
        """What the integers add to float64, for each output: over the box, and over the data X, if any."""
        found = []
        for over, X in (("the box", self.box(TRIED)), ("X", self.sample)):
            if X is not None:
                want, got = np.asarray(self.model.reference(X), float), self.values(X)
                for k, o in enumerate(self.outputs[: want.shape[1]]):
                    want[:, k] = np.clip(want[:, k], o.lo * o.step, o.hi * o.step)
                    away = np.abs(got[:, k] - want[:, k])
                    spread = float(np.std(want[:, k]))
                    if spread < 1e-9 * float(np.abs(want[:, k]).max()):  # a constant's is its size
                        spread = float(np.abs(want[:, k]).max())
                    rms = float(np.sqrt(np.mean(away**2)))
                    found.append(Error(self.outputs[k].name, over, len(X), float(away.max()), rms, spread))
        return tuple(found)

    def python(self) -> str:
        """A Python module without dependencies, for CPython and any MicroPython: `predict(x, out)`."""
        names = [f.name for f in self.features]
        head = (
            f'"""A regression in integers: {len(names)} features, {len(self.outputs)} outputs.\n\n'
            "    out = [0] * SIZE\n    predict(x, out)\n\n"
            "x: integers, the values of FEATURES over their STEPS, rounded.\n"
            "out[k] times UNIT_OF[k] is the value of OUTPUTS[k]; both are text, for ports without floats.\n"
            "Features beyond BOX are held at its ends.\n"
            f'Every intermediate stays within +-2^30 (largest {self.proof.largest}).\n"""\n\n'
        )
        rows = (
            ("FEATURES", names),
            ("STEPS", [f.step for f in self.features]),
            ("BOX", [(f.lo, f.hi) for f in self.features]),
            ("OUTPUTS", [o.name for o in self.outputs]),
            ("UNIT_OF", [o.step for o in self.outputs]),
            ("UNITS", [o.unit for o in self.outputs]),
        )
        facts = "".join(f"{name} = (\n{_listed(values)})\n" for name, values in rows)
        facts += f"SIZE = {len(self.outputs)}\n"
        if self.classes:
            facts += f"CLASSES = (\n{_listed(self.classes)})\n"
        text = sources.python_helpers(self.code)
        body = sources.python_body(self.code)
        return (
            f"{head}{facts}\n\n{text}def predict(x, out):\n"
            '    """The outputs into out[0], out[1], .. from the features x, all of them integers."""\n'
            + body
        )

    def mpy(self, arch: str = mpy.BYTECODE) -> bytes:
        """The module compiled by mpy-cross: machine code for an architecture, or bytecode for any board."""
        return mpy.compiled(self.python(), "model.py", arch)

    def c(self, name: str = "predict") -> str:
        """A C99 header without dependencies: `void predict(const int32_t *x, int32_t *out)`."""
        lines = [
            "/* A regression in 32-bit integers; no library, no floats.",
            *(f" * x[{i}]: {f.name} / {f.step:g}" for i, f in enumerate(self.features)),
            *(f" * out[{k}]: {o.name} / {o.step:g} {o.unit}".rstrip() for k, o in enumerate(self.outputs)),
            *(f" * verdict {k}: {c}" for k, c in enumerate(self.classes)),
            f" * Every intermediate stays within +-2^30 (largest {self.proof.largest}). */",
            "#include <stdint.h>",
            "",
            "/* a shift to the right is to keep the sign, as it does on every compiler that we know */",
            "typedef char palpate_needs_arithmetic_shifts[(-1 >> 1) == -1 ? 1 : -1];",
            f"enum {{ {name.upper()}_FEATURES = {len(self.features)}, "
            f"{name.upper()}_OUTPUTS = {len(self.outputs)} }};",
            "",
        ]
        body = f"static void {name}(const int32_t *x, int32_t *out)\n{{\n{sources.c_body(self.code)}}}\n"
        return "\n".join(lines) + "\n" + sources.c_helpers(self.code) + body

    def image(
        self, key: Any, like: Any = None, first: Program | None = None, device: str | None = None
    ) -> bytes:
        """Signed, for the slots of a probe or of another board, where the evaluator can run the program.

        Parameters
        ----------
        key : path
            Directory made by `palpate keygen`.
        like, first, device : optional
            `device` names a board of one's own. See `palpate.model_export.program_image.image`, which also
            gives a report.

        Raises
        ------
        palpate.PalpateError
            In one sentence: what the evaluator cannot run, by its name.
        """
        try:  # by its name: the compiler does without the rest of Palpate, an image does not
            probes = import_module("palpate.model_export.program_image")
        except ModuleNotFoundError:
            raise CompileError("a probe's image needs the whole of Palpate; install palpate") from None
        made: bytes = probes.image(self, key, like, first, device)[0]
        return made


def _listed(values: Sequence[Any]) -> str:
    plain = [v.item() if hasattr(v, "item") else v for v in values]
    return "".join(f"    {repr(v) if isinstance(v, float) else v!r},\n" for v in plain)


def assemble(
    outputs: Sequence[Output],
    code: Code,
    model: Model,
    sample: Array | None = None,
    calibration: Calibration | None = None,
) -> Program:
    """Prove the code for whatever a feature may be, and make a program of it."""
    features = tuple(model.space.features)
    whole = [(1 - LIMIT, LIMIT - 1)] * len(features)
    code = code.needed()
    proof, ends = code.prove(whole, len(outputs))
    told = tuple(Output(o.name, o.unit, o.step, lo, hi) for o, (lo, hi) in zip(outputs, ends, strict=True))
    return Program(features, told, tuple(model.classes), code, proof, model, sample, calibration)
