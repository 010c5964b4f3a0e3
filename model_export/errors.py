"""What can go wrong on the way from a fitted model to an image, as a tree.

    ExportError
      ModelError  (UsageError)   model.json, or a ModelSpec, that does not make sense
      ProofError                 a model whose integers cannot be proved to stay within +-2^30
      SigningError               a signing key that is missing, damaged or of the old kind
      ImageError  (UsageError)   bytes that are not a model image, or not one that we can read

The text of each is one sentence that says what was wrong and what to do.
"""

from __future__ import annotations

from palpate.errors import PalpateError, UsageError


class ExportError(PalpateError):
    """Any error of `model_export`."""


class ModelError(ExportError, UsageError):
    """The model's description does not make sense."""


class ProofError(ExportError):
    """No proof that every intermediate of the evaluation stays within +-2^30."""


class SigningError(ExportError):
    """The signing key cannot be used."""


class ImageError(ExportError, UsageError):
    """The bytes are not a model image of a version that we can read."""
