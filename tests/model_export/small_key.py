"""A set of SLH-DSA of its own, some hundred times quicker to sign and a quarter as long, for tests of what
surrounds a signature. The code is the real one; the set is registered here and nowhere else, so that no probe
but one in this process believes such a key.
"""

from __future__ import annotations

from firmware_py import signature, slh_dsa
from palpate.model_export.signing import slh_sign

SMALL = 200
slh_dsa.SETS[SMALL] = (2, 4, 8, 4)


def secret(number: int = 0) -> slh_sign.Secret:
    """A private key of the small set."""
    return slh_sign.Secret(*(bytes((number, k)) * 8 for k in range(3)), set=SMALL)


def signer(number: int = 0):
    """(public key, sign): sign(body) gives body and signature."""
    key = secret(number)
    public = slh_sign.public_key(key)
    return public, lambda body, context=signature.MODEL: body + slh_sign.sign(key, public, body, context)
