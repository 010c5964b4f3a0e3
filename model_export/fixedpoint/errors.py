"""What can go wrong on the way from a regression to integers; the text of each is one sentence.

CompileError  (ValueError)  a model, or data, that cannot be compiled, with the nearest thing that can
  ProofError                integers that cannot be proved to stay within +-2^30
"""


class CompileError(ValueError):
    """The model cannot be compiled."""


class ProofError(CompileError):
    """No proof that every intermediate stays within +-2^30."""
