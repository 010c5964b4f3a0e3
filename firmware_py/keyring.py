"""Whose models a probe takes: the key it was installed with, or one that took its place.

A *succession* is a new public key, signed by the one before it. It comes over the wire like a model; once
it is kept, only models of the new key are taken, and those that are already here stay.
"""

from firmware_py import safe_record, status

SUCCESSION = b"PALK\x01\0\0\0"  # what one begins with; then the new public key and the old one's signature


def name(key):
    """Eight bytes that stand for a public key where a model has its id."""
    return bytes(key[4:12])


class Keyring:
    """`current`: whose models are taken (empty: nobody's); `before`: whose models stay.

    Parameters: the store; the public key that was installed (slh_dsa.py).
    """

    def __init__(self, store, installed):
        self.record = safe_record.Record(store, "key")
        self.installed = installed
        self.current = installed
        self.before = b""

    def load(self):
        """Read what is kept; the record's state (safe_record.py)."""
        self.current = self.installed
        self.before = b""
        kept = self.record.load()
        n = len(self.installed)
        if self.record.state == status.ROTTEN:
            # not the installed one: it may have been given up for good reason
            self.current = b""
        elif kept is not None and len(kept) == 3 * n and kept[:n] == self.installed:
            # (of another installation, it is of no account)
            self.current = kept[n : 2 * n]
            self.before = kept[2 * n :]
        return self.record.state

    def least(self):
        """Bytes of the shortest thing that can be signed."""
        from firmware_py import slh_dsa

        return slh_dsa.signature_size(self.current) + len(SUCCESSION) + len(self.installed)

    def signed(self, read, size):
        """(status, key) of a model: who has signed it."""
        from firmware_py import slh_dsa

        code = slh_dsa.verify(self.current, read, size)
        if code == status.BAD_SIGNATURE and self.before:
            return slh_dsa.verify(self.before, read, size), self.before
        return code, self.current

    def successor(self, read, size):
        """(status, public key) of a succession."""
        from firmware_py import slh_dsa

        code = slh_dsa.verify(self.current, read, size, slh_dsa.SUCCESSOR)
        at = len(SUCCESSION)
        key = read(at, len(self.installed))
        if code == status.OK and (size != self.least() or not slh_dsa.parameters(key)):
            code = status.BAD_MODEL
        return code, key

    def take(self, key):
        """Put `key` in the current one's place, for good. A status."""
        code = self.record.save(self.installed + key + self.current)
        if code == status.OK:
            self.before = self.current
            self.current = key
        return code
