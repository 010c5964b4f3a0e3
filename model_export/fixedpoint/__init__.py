"""A regression as proven integers, for devices without floats: from scikit-learn, statsmodels, or terms.

    from palpate.fixedpoint import compile, from_sklearn

    program = from_sklearn(pipeline, X, units=("mm",))
    program.proof                       # every intermediate inside 31 bits, whatever the features
    program.errors                      # what the integers add to float64, over the box and over X
    program.predict(X)                  # the device's integers, in numpy
    program.python(), program.mpy("armv6m"), program.c()

It imports numpy, and of the device's files the arithmetic, alone.
"""

from palpate.fixedpoint.errors import CompileError, ProofError
from palpate.fixedpoint.program import Program
from palpate.fixedpoint.sklearn_models import from_sklearn
from palpate.fixedpoint.statsmodels_models import from_statsmodels
from palpate.fixedpoint.terms import compile

__all__ = ["CompileError", "Program", "ProofError", "compile", "from_sklearn", "from_statsmodels"]
