"""Trees of scikit-learn's ensembles: thresholds as integers of the features, leaves in float64."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.fixedpoint.errors import CompileError
from palpate.fixedpoint.refusals import refused
from palpate.fixedpoint.space import Space
from palpate.fixedpoint.transformers import Column, Raw

MOST_NODES = 20_000


class Splits:
    """What splits of columns are for the device's features: a column must be a feature, moved and scaled.

    Parameters
    ----------
    space : Space
    columns : list of Column
    whose : the ensemble, for its name in errors
    """

    def __init__(self, space: Space, columns: list[Column], whose: Any) -> None:
        self.nodes = 0
        self.of: list[tuple[int, float, float]] = []
        for column in columns:
            if isinstance(column, Raw):
                feature, factor, offset = column.feature, 1.0, 0.0
            else:
                terms = [t for t, c in column.items() if t and c]
                atom = space.atoms[terms[0][0]] if len(terms) == 1 and len(terms[0]) == 1 else None
                if atom is None or atom.function is not None:
                    raise refused(
                        whose, "its trees split something that is not a feature, moved and scaled",
                        "the trees without the transformer: they need none",
                    )  # fmt: skip
                feature, factor = atom.feature, column[terms[0]] / atom.radius
                offset = column.get((), 0.0) - factor * space.zeros.get(terms[0][0], atom.centre)
            self.of.append((feature, factor, offset))
        self.features = space.features

    def node(self, column: int, threshold: float, below: Any, above: Any) -> Any:
        """A tree that takes `below` where the column is at most the threshold."""
        self.nodes += 1
        if self.nodes > MOST_NODES:
            raise CompileError(
                f"the trees have more than {MOST_NODES} nodes; take fewer or shallower ones "
                "(n_estimators, max_depth, max_leaf_nodes)"
            )
        feature, factor, offset = self.of[column]
        at, of = (threshold - offset) / factor, self.features[feature]
        if factor > 0:
            whole = of.last_at(at)
        else:  # column <= threshold where the feature is at least `at`
            whole = of.first_at(at) - 1
            below, above = above, below
        if whole < of.lo:  # held to its box it is always above
            return above
        return below if whole >= of.hi else (feature, whole, below, above)


def of_arrays(tree: Any, leaf: np.ndarray, splits: Splits, at: int = 0) -> Any:
    """A tree of `sklearn.tree`, with a value for each node."""
    if tree.children_left[at] < 0:
        return float(leaf[at])
    below, above = (of_arrays(tree, leaf, splits, c[at]) for c in (tree.children_left, tree.children_right))
    return splits.node(int(tree.feature[at]), float(tree.threshold[at]), below, above)


def of_histograms(nodes: Any, splits: Splits, whose: Any, at: int = 0) -> Any:
    """A tree of HistGradientBoosting."""
    row = nodes[at]
    if row["is_leaf"]:
        return float(row["value"])
    if row["is_categorical"]:
        raise refused(
            whose, "it splits categories", "numbers for the categories, without categorical_features"
        )
    below, above = (of_histograms(nodes, splits, whose, int(row[c])) for c in ("left", "right"))
    return splits.node(int(row["feature_idx"]), float(row["num_threshold"]), below, above)
