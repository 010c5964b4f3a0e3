"""Why a model is not for a stroke: the probe says so in one bit, the host reads the reasons in the features.

They are worked out in float64: of a stroke at the very edge there may be none.
"""

from __future__ import annotations

from palpate.answer.across import Floats
from palpate.answer.words import UNFAMILIAR, WITHOUT_PRESS
from palpate.model_export.integers.reference import evaluate
from palpate.model_export.schema import ModelSpec
from palpate.model_export.vocabulary import ABSENT, OF_THE_PRESS
from palpate.wire.events import OUTPUTS


def why_outside(spec: ModelSpec, x: Floats) -> tuple[str, ...]:
    """Keys of `answer.outside_words`: outputs that lie beyond their ranges, then checks by their names.

    Parameters
    ----------
    spec : ModelSpec
    x : (1, features)
        Of `reference.inputs`.
    """
    if any(name in OF_THE_PRESS and value == ABSENT for name, value in zip(spec.features, x[0])):
        return (WITHOUT_PRESS,)
    said = evaluate(spec, x)
    checks = () if spec.checks is None else spec.checks.estimates
    why = [name for name, beyond in zip(OUTPUTS, said["beyond"][0]) if beyond]
    why += [check.name for check, above in zip(checks, said["unlike"][0]) if above]
    if not why and (said["distance"][0] > 1 or not said["boxed"][0].all()):
        why = [UNFAMILIAR]
    return tuple(why)
