"""The emitted module, readable or compiled, gives the integers of the image."""

from __future__ import annotations

import functools
import json
import subprocess
import sys

import numpy as np
import pytest

from firmware_py import evaluator, feature_names, status
from palpate import models
from palpate.model_export.errors import ModelError
from palpate.model_export.integers import compiler
from palpate.model_export.source import emit
from tests.micropython import run_micropython
from tests.model_export import synthetic
from tests.model_export.flashing import body_of
from tests.model_export.test_checks import pressed
from tests.model_export.test_micropython import rows
from tests.model_export.test_two_stages import Q24, answers, loaded, said

SCRIPT = """
import json, sys
sys.path.insert(0, '')
import palpate_model as m
out = [0] * m.SIZE
answers = []
for row in json.loads(open('vectors.json').read()):
    answers.append([m.estimate(row, out)] + out)
print(json.dumps(answers))
"""


def chosen(spec, vectors):
    """Rows of all features cut to those of the emitted module, in its order."""
    names = [*spec.features, *(r.feature for r in spec.lump if r.feature not in spec.features)]
    return [[row[i] for i in compiler.feature_ids(names)] for row in vectors]


@pytest.mark.parametrize(("kind", "degree"), [("thesis", 2), ("field", 2), ("field", 3)])
def test_the_module_stands_alone_on_cpython(kind, degree, tmp_path):
    spec = synthetic.model(kind, degree)
    vectors = rows(spec, 300)
    (tmp_path / "palpate_model.py").write_text(emit.emit_py(spec))
    (tmp_path / "vectors.json").write_text(json.dumps(chosen(spec, vectors)))
    said = subprocess.run(
        [sys.executable, "-S", "-c", SCRIPT], cwd=tmp_path, capture_output=True, text=True, check=True
    ).stdout
    assert json.loads(said) == answers(compiler.compile_model(spec), vectors)


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize(("kind", "degree"), [("thesis", 2), ("field", 2), ("field", 3)])
def test_and_on_micropython_as_source_and_as_bytecode(compiled, kind, degree):
    spec = synthetic.model(kind, degree)
    vectors = rows(spec, 200)
    files = {"vectors.json": json.dumps(chosen(spec, vectors)).encode()}
    if compiled:
        files["palpate_model.mpy"] = emit.emit_mpy(spec)
    else:
        files["palpate_model.py"] = emit.emit_py(spec).encode()
    assert json.loads(run_micropython(SCRIPT, files)) == answers(compiler.compile_model(spec), vectors)


@functools.cache
def bundled(name):
    """A model that comes with Palpate, its module's function, strokes, and what the image says of them."""
    spec = models.load(name)
    X = pressed(spec, 100)
    code, model = loaded(body_of(spec))
    assert code == status.OK
    space: dict = {}
    exec(emit.emit_py(spec), space)
    columns = [feature_names.NAMES.index(feature) for feature in space["FEATURES"]]
    given = np.round(X * Q24).astype(int)[:, columns].tolist()
    return spec, space["estimate"], given, said(model, X).tolist()


@pytest.mark.parametrize("name", [models.FIELD, models.TOLD])
def test_two_stages_and_checks_are_in_the_module(name):
    """`field` was refused: "a model of two stages is exported as an image only"."""
    _, estimate, given, wanted = bundled(name)
    out = [0] * evaluator.OUT_SIZE
    assert [[estimate(row, out), *out] for row in given] == wanted


def test_and_so_they_are_on_micropython():
    spec, _, given, wanted = bundled(models.FIELD)
    files = {"vectors.json": json.dumps(given[40:60]).encode(), "palpate_model.mpy": emit.emit_mpy(spec)}
    assert json.loads(run_micropython(SCRIPT, files)) == wanted[40:60]


@pytest.mark.parametrize("arch", ["armv6m", "armv7emsp", "xtensawin", "rv32imc"])
def test_machine_code_for_boards(arch, thesis):
    code = emit.emit_mpy(thesis, arch)
    assert code[:2] == b"M\x06"
    assert code[2] >> 2 != 0  # names an architecture
    assert emit.emit_mpy(thesis)[2] >> 2 == 0


def test_an_unknown_architecture_is_named(thesis):
    with pytest.raises(ModelError, match="pdp11"):
        emit.emit_mpy(thesis, "pdp11")


def test_the_module_is_readable(field):
    text = emit.emit_py(field)
    assert "# F_N_per_m: ln_force * (ln_force, asinh_amp, " in text
    assert '"""Estimate into' in text
    assert max(map(len, text.splitlines())) < 125
