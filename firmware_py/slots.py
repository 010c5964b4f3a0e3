"""A new model is received into the slot that is not live, verified, tried, confirmed.

    begin -> write ... -> verify -> try_ -> confirm        (abort at any time)

A power cut at any moment leaves the old model live until the moment in which the record's new copy is whole,
and the new one from then on (live_model.py). A successor of the key comes the same way (keyring.py).
"""

from firmware_py import geometry, keyring, live_model, status

NAMES = live_model.NAMES
TRIAL = live_model.TRIAL
MAX_SIZE = 32768
PAGE = 1024  # bytes kept together: each time a file grows, the flash chip erases a block of its own

IDLE = 0
RECEIVING = 1
VERIFIED = 2
TRIED = 3


class Slots(live_model.LiveModel):
    """The model slots of a probe: what is live (live_model.LiveModel), and what is on its way.

    Parameters: those of LiveModel, and the largest image. `state` is one of the numbers above.
    """

    def __init__(self, store, key, features_version, feature_count, probe=geometry.NAME, max_size=MAX_SIZE):
        live_model.LiveModel.__init__(self, store, key, features_version, feature_count, probe)
        self.max_size = max_size
        self._forget()

    def boot(self):
        """Find the live model (LiveModel.boot); nothing is on its way."""
        self._forget()
        return live_model.LiveModel.boot(self)

    def _forget(self):
        self.trial = None
        self.trial_id = b""  # of the model that was verified
        self.successor = b""  # moment and public key of a succession that was verified
        self.state = IDLE
        self.received = 0
        self.size = 0
        self._page = bytearray()
        self._target = 0

    def begin(self, size):
        """Make room for an image of `size` bytes in the slot that is not live. A status.

        If an image of that size is already on its way it goes on: `received` says from where.
        """
        from firmware_py import signature

        if not signature.available():
            return status.NOT_SUPPORTED
        if self.state == RECEIVING and size == self.size:
            return status.OK
        self.abort()
        if size <= 0:
            return status.BAD_VALUE
        if size < self.keys.least():
            return status.BAD_SIGNATURE  # too short to have one
        if size > self.max_size:
            return status.NO_SPACE
        self._target = self.spare()
        code = self.store.create(NAMES[self._target])
        if code != status.OK:
            return code
        self.state = RECEIVING
        self.size = size
        self.received = 0
        self._page = bytearray(PAGE)
        return status.OK

    def write(self, offset, data):
        """The next piece of the image, or one that was already taken (then it is done). A status.

        Whole pages go into the store, and the rest with the last piece.
        """
        if self.state != RECEIVING:
            return status.BAD_STATE
        if offset < 0 or offset > self.received or offset + len(data) > self.size:
            return status.BAD_VALUE
        at = self.received - offset
        while at < len(data):
            held = self.received % PAGE
            n = min(PAGE - held, len(data) - at)
            self._page[held : held + n] = data[at : at + n]
            self.received += n
            at += n
            held += n
            if held == PAGE or self.received == self.size:
                code = self.store.append(NAMES[self._target], memoryview(self._page)[:held])
                if code != status.OK:
                    self.abort()  # how much of the page arrived is unknown
                    return code
        return status.OK

    def verify(self):
        """Is what was received a whole image, signed with our key, for this probe, new enough? A status.

        Anything but OK drops it, except BAD_STATE: before the last piece, or without a begin.
        """
        if self.state >= VERIFIED:
            return status.OK
        # the live model comes back when `_verify` has returned: as long as it runs, what is left on its stack
        # may keep the tables of the one on trial from being cleared away
        code = self._verify()
        if self.state != VERIFIED:
            self.take_back()
        return code

    def _verify(self):
        if self.state != RECEIVING or self.received != self.size:
            return status.BAD_STATE
        self._page = bytearray()
        self.store.sync()
        slot = self._target
        code = status.STORE_ERROR
        if self.store.size(NAMES[slot]) == self.size:
            read = self._reader(slot)
            if read(0, len(keyring.SUCCESSION)) == keyring.SUCCESSION:
                code, self.successor = self.keys.successor(read, self.size)
                if code == status.OK:
                    self.state = TRIED  # there is nothing to try
                else:
                    self._drop()
                return code
            code, body = self._signed(slot, self.size, False)
        if code == status.OK:
            # should it hang, the next start says so; what is live has not been touched
            code = self.store.create(TRIAL, self.store.read(NAMES[slot], 40, 8))
            self.store.sync()
        if code == status.OK:
            self.set_aside()
            code, self.trial = self._load(slot, body)
        if self.trial is not None:
            self.trial_id = self.trial.model_id
            code = self._new_enough(self.trial)
        if code != status.OK:
            self._drop()
            return code
        self.state = VERIFIED
        return status.OK

    def try_(self):
        """Run the new model on the vectors it carries; the integers must be those it states. A status."""
        if self.state == TRIED:
            return status.OK
        if self.state != VERIFIED:
            return status.BAD_STATE
        code = self._try()
        self.take_back()
        return code

    def _try(self):
        code = self._self_test(self.trial, self._target)
        self.trial = None  # its place is needed
        self.store.remove(TRIAL)
        if code != status.OK:
            self._drop()
            return code
        self.state = TRIED
        return status.OK

    def confirm(self):
        """Make the tried model the live one, for good. A status; unless it is OK the old one stays live.

        Signature and vectors are tried once more, on what lies in the flash now.
        """
        if self.state != TRIED:
            return status.BAD_STATE
        if self.successor:
            code = self.keys.take(self.successor)
            if code == status.OK:
                self._drop()
            return code
        self.set_aside()
        code = self._confirm()
        self.take_back()
        return code

    def _confirm(self):
        code, model = self._open(self._target)
        if code == status.OK and model.model_id != self.trial_id:
            code = status.STORE_ERROR
        if code == status.OK:
            code = self._make_live(self._target, model)
        if code == status.OK:
            self.trial_id = b""
            self.state = IDLE
        return code

    def abort(self):
        """Drop a model that is on its way; the live one is not touched."""
        self._drop()
        self.take_back()
        return status.OK

    def _drop(self):
        if self.state != IDLE:
            self.store.remove(NAMES[self._target])
            if self.store.size(TRIAL) >= 0:
                self.store.remove(TRIAL)
        self.trial = None
        self.trial_id = b""
        self.successor = b""
        self._page = bytearray()
        self.state = IDLE
        self.received = 0
