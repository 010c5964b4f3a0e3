"""Strokes that nobody felt: truths and features as a test wants them."""

import numpy as np

from palpate.features import press_features
from palpate.learn.observed import NAMES, TISSUE, Observed
from palpate.learn.probe_model import OUTPUTS

WIDTHS = {"truth": len(OUTPUTS), "tissue": len(TISSUE), "columns": 26, "across": 2}


def made_up(n, groups, **parts):
    """n whole strokes that found a lump; what `parts` does not give is 0. `press`: features of the press."""
    X = np.array(parts.pop("X", np.zeros((n, len(NAMES)))))
    press = parts.pop("press", None)
    if press is not None:
        X[:, press_features.PLACES[: press.shape[1]]] = press
    rest = {name: np.zeros((n, width)) for name, width in WIDTHS.items()} | parts
    return Observed(X=X, whole=np.ones(n, bool), found=np.ones(n, bool), group=groups, **rest)


def smooth(lumps, draws, rng, depth=(2.2, 0.6), t=(2.6, 0.5)):
    """Strokes whose features are smooth in a truth that the press tells in part.

    depth, t : the middle of their logarithms, and how far these vary.
    """
    g = np.repeat(np.arange(lumps), draws)
    n = len(g)
    u = rng.uniform(-1, 1, (lumps, 6))[g]
    ln_F, reach = rng.uniform(np.log(25), np.log(150), n), 1.5 + 0.6 * u[:, 4]
    ln_d, ln_depth, ln_t = 2.4 + 0.6 * u[:, 0], depth[0] + depth[1] * u[:, 1], t[0] + t[1] * u[:, 2]
    truth = np.column_stack([ln_F, ln_t, ln_d, ln_depth - ln_d, 0.32 + 0.3 * u[:, 3], ln_F - reach])
    tissue = np.column_stack([ln_depth, reach, 5 + 3 * u[:, 5], 19 + 10 * u[:, 5]])
    X = 0.01 * rng.standard_normal((n, len(NAMES)))
    for k in range(len(NAMES)):
        mixed = np.random.default_rng(k).standard_normal(5)
        X[:, k] += u[:, :4] @ mixed[:4] * (1 + 0.1 * u[:, 0]) + mixed[4] * u[:, 4]
    X[:, NAMES.index("ln_force")] = ln_F + 0.005 * rng.standard_normal(n)
    X[:, NAMES.index("ln_base")] = ln_F + 0.3 * u[:, 2]
    press = np.column_stack([u[:, 4] + 0.1 * k * u[:, 2] + 0.05 * u[:, 5] for k in range(9)])
    press += 0.005 * rng.standard_normal(press.shape)
    return made_up(n, g, X=X, truth=truth, tissue=tissue, press=press)
