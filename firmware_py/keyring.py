"""Whose models a probe takes: the key it was installed with, or one that took its place.

A *succession* is a new public key, signed by the one before it. It comes over the wire like a model; once
it is kept, only models of the new key are taken, and those that are already here stay. It names the moment
of its signing, and none is taken that is not younger than the last: where a key comes back, the succession
that it had signed before does not.
"""

from firmware_py import safe_record, status

SUCCESSION = b"PALK\x02\0\0\0"  # what one begins with; then moment, new public key, the old one's signature
MOMENT = 8  # bytes, the highest first: they compare as the numbers do


def name(key):
    """Eight bytes that stand for a public key where a model has its id."""
    return bytes(key[4:12])


class Keyring:
    """`current`: whose models are taken (empty: nobody's); `before`: whose models stay.

    Parameters: the store; the public key that was installed (signature.py).
    """

    def __init__(self, store, installed):
        self.record = safe_record.Record(store, "key")
        self.installed = installed
        self.current = installed
        self.before = b""
        self.moment = bytes(MOMENT)  # of the last succession

    def load(self):
        """Read what is kept; the record's state (safe_record.py)."""
        self.current = self.installed
        self.before = b""
        self.moment = bytes(MOMENT)
        kept = self.record.load()
        n = len(self.installed)
        if self.record.state == status.ROTTEN:
            # not the installed one: it may have been given up for good reason
            self.current = b""
        elif kept is not None and len(kept) in (3 * n, 3 * n + MOMENT) and kept[:n] == self.installed:
            # (of another installation, it is of no account; firmware before this one kept no moment)
            self.current = kept[n : 2 * n]
            self.before = kept[2 * n : 3 * n]
            self.moment = kept[3 * n :] or self.moment
        return self.record.state

    def least(self):
        """Bytes of the shortest thing that can be signed."""
        from firmware_py import signature

        return signature.size(self.current) + len(SUCCESSION) + MOMENT + len(self.installed)

    def signed(self, read, size, stays=True):
        """(status, bytes) of a model: whether it is signed, and how many bytes stand before the signature.

        stays: with the key before the current one it is good, too.
        """
        from firmware_py import signature

        key = self.current
        code = signature.verify(key, read, size)
        if code == status.BAD_SIGNATURE and stays and self.before:
            key = self.before
            code = signature.verify(key, read, size)
        return code, size - signature.size(key)

    def successor(self, read, size):
        """(status, moment and public key) of a succession."""
        from firmware_py import signature

        code = signature.verify(self.current, read, size, signature.SUCCESSOR)
        named = read(len(SUCCESSION), MOMENT + len(self.installed))
        if code == status.OK and (size != self.least() or not signature.size(named[MOMENT:])):
            code = status.BAD_MODEL
        if code == status.OK and named[:MOMENT] <= self.moment:
            code = status.TOO_OLD
        return code, named

    def take(self, named):
        """Put the key that a succession names in the current one's place, for good. A status."""
        moment = named[:MOMENT]
        key = named[MOMENT:]
        code = self.record.save(self.installed + key + self.current + moment)
        if code == status.OK:
            self.before = self.current
            self.current = key
            self.moment = moment
        return code
