"""A twin of the model `field`, built with plain scikit-learn, takes the words that our exporter gives it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from firmware_py import evaluator
from palpate import models
from palpate.fixedpoint import Program, from_sklearn
from palpate.fixedpoint.quantise import GOOD_WORST
from palpate.model_export.integers import compiler, sampling

ROWS = 2000


@cache
def spec():
    return models.load("field")


@cache
def twin():
    """The pipeline (all terms of degree 3, most of them 0) and data like those that the model is for."""
    of = spec()
    X = sampling.in_domain(of, ROWS)
    pipeline = make_pipeline(StandardScaler(), PolynomialFeatures(3), LinearRegression(fit_intercept=False))
    pipeline.fit(X[:30], np.zeros((30, len(of.outputs))))
    scaler, powers, line = (step for _, step in pipeline.steps)
    scaler.mean_, scaler.scale_ = np.array(of.centre), np.array(of.scale)
    place = {tuple(np.repeat(np.arange(len(row)), row).tolist()): k for k, row in enumerate(powers.powers_)}
    line.coef_ = np.zeros((len(of.outputs), len(place)))
    for k, term in enumerate(of.terms):
        line.coef_[:, place[term]] = [output.coefficients[k] for output in of.outputs]
    return pipeline, X


def compiled(**how) -> Program:
    of = spec()
    pipeline, X = twin()
    box = list(zip(of.clip_lo, of.clip_hi))
    return from_sklearn(pipeline, X, box=box, steps=[2.0**-24] * len(box), **how)


def words(program: Program) -> int:
    """Of its coefficients, where products are summed."""
    return sum(len(let.value.args[0]) for let in program.code.lets if let.value.op == "dot") + sum(
        len(arg.args[0]) for let in program.code.lets for arg in _inside(let.value) if arg.op == "dot"
    )


def _inside(node):
    for arg in node.args:
        if hasattr(arg, "op"):
            yield arg
            yield from _inside(arg)


def own_words() -> int:
    """Of the image: the same, of the outputs' sums."""
    tables = compiler.compile_model(spec())
    n = tables.head[evaluator.LEAVES] * evaluator.OUTPUTS
    return int(np.count_nonzero(tables.c[:n]) + np.count_nonzero(tables.d[:n]))


def our_precision() -> list[float]:
    """The worst error that our exporter wants: of logarithms, and relative to E^-2/3, as it mostly is."""
    pipeline, X = twin()
    said = np.abs(pipeline.predict(X))
    floors = [(o.hi - o.lo) / 10 for o in spec().outputs]
    sizes = [
        1.0 if o.link == "ln" else float(np.median(np.maximum(said[:, k], floors[k])))
        for k, o in enumerate(spec().outputs)
    ]
    return [GOOD_WORST * size for size in sizes]


def test_the_twin_takes_our_words_at_our_precision():
    found, own = words(compiled(within=our_precision(), precise="data")), own_words()
    print(f"ours {own} words, the twin's {found}")
    assert found <= own + 1


@pytest.mark.long
def test_errors_of_a_hundred_thousandth_over_the_whole_box_take_more():
    usual, own = words(compiled()), own_words()
    print(f"ours {own} words, the twin's {usual}")
    assert own < usual < 1.2 * own
