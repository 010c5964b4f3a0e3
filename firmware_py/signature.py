"""The signatures that a probe believes: those of SLH-DSA. Another scheme is another module, named here.

The half that signs is named in `model_export/signing/keys.py`.

A scheme says whether this board can verify at all (`available`), how long the signature under a public key is
(`size`, 0 for a key that is none) and whether a signature is good (`verify`). It is loaded while a model is
checked and given back afterwards (memory.py), so it is imported inside functions.
"""

from firmware_py import slh_dsa as scheme

# what a signature is for, so that one cannot be taken for another
MODEL = b"palpate model"
SUCCESSOR = b"palpate key"

available = scheme.available
size = scheme.signature_size


def verify(key, read, size, context=MODEL):
    """Does the end of what `read(offset, n)` gives (size bytes in all) sign what stands before it?

    OK, BAD_SIGNATURE, or NOT_SUPPORTED where the board cannot tell.
    """
    return scheme.verify(key, read, size, context)
