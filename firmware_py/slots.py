"""Two slots for models and the record of which is live: a new model is received, verified, tried, confirmed.

    begin -> write ... -> verify -> try_ -> confirm        (abort at any time)

The live slot is never written. A power cut at any moment leaves the old model live until the
moment in which the record's new copy is whole, and the new one from then on. Nothing has to be undone
at the next start: `boot` only reads, so it may itself be cut as often as one likes. `settle`, after it,
repairs what had rotted. A successor of the key comes the same way (keyring.py).
"""

from firmware_py import keyring, model_image, safe_record, slh_dsa, status

NAMES = ("model0", "model1")
MAX_SIZE = 32768

IDLE = 0
RECEIVING = 1
VERIFIED = 2
TRIED = 3

TRIAL = "trial"  # there while a model is being tried: its id

_NONE = 255
_RECORD = 21  # live slot (1), highest counter (4), id of the live model (8) and of the one before it (8)


class Slots:
    """The model slots of a probe.

    Parameters: the store; the public key that signs models (slh_dsa.py); what this firmware
    computes (features_version, feature_count); the probe's identity (model_image.PROBE); the largest image.
    `model` is the live model (model_image.Model) or None; `state` is one of the numbers above. After `boot`,
    `health` is OK or the worst of REPAIRED, ROTTEN and TRIAL_HUNG (status.py).
    """

    def __init__(
        self, store, key, features_version, feature_count, probe=model_image.PROBE, max_size=MAX_SIZE
    ):
        self.store = store
        self.keys = keyring.Keyring(store, key)
        self.health = status.OK
        self.features_version = features_version
        self.feature_count = feature_count
        self.probe = probe
        self.max_size = max_size
        self.record = safe_record.Record(store, "live")
        self.model = None
        self.trial = None
        self.successor = b""  # the public key of a succession that was verified
        self.state = IDLE
        self.received = 0
        self.size = 0
        self._live = _NONE
        self._highest = 0
        self._target = 0

    # -- starting up

    def boot(self):
        """Find the live model: OK with `model` set, or NO_MODEL. Reads only.

        The slot that the record names comes first. Should it be damaged, the other one serves if it is
        the model that was live before, or new enough to be flashed. Should the record be damaged beyond
        repair, the slots themselves say which model is the newest, so that the counter does not fall.
        """
        self.model = None
        self.trial = None
        self.state = IDLE
        self._live = _NONE
        self._highest = 0
        self.health = status.TRIAL_HUNG if self.store.size(TRIAL) > 0 else status.OK
        self._note(self.keys.load())
        kept = self.record.load()
        self._note(self.record.state)
        if kept is None or len(kept) != _RECORD or self.record.state == status.ROTTEN:
            # gone, or never there: with nothing left of it, nothing in the slots was ever confirmed
            return self._recover() if self.health == status.ROTTEN else status.NO_MODEL
        self._highest = model_image.u32(kept, 1)
        live = kept[0]
        if live > 1:
            return status.NO_MODEL
        code, model = self._open(live)
        if code == status.OK and model.model_id == kept[5:13]:
            self._live = live
            self.model = model
            return status.OK
        self._note(status.ROTTEN)
        code, model = self._open(1 - live)
        if code == status.OK and (
            model.model_id == kept[13:21] or self._new_enough(model.header) == status.OK
        ):
            self._live = 1 - live
            self.model = model
            return status.OK
        return status.NO_MODEL

    def settle(self):
        """Write again what `boot` found damaged and could work out, and forget a trial that hung."""
        self.keys.record.restore()
        if self.record.restore() is None and self.model:
            self.record.save(self._record_of(self._live, self.model, None))
        if self.store.size(TRIAL) > 0:
            self.store.remove(TRIAL)

    def _note(self, code):
        """Keep the worst of what boot has found."""
        if code == status.ROTTEN or (code == status.REPAIRED and self.health == status.OK):
            self.health = code

    def _recover(self):
        """The newest model of either slot, where the record is lost."""
        for slot in range(2):
            code, model = self._open(slot)
            if code == status.OK and self._new_enough(model.header) == status.OK:
                self._highest = max(model.header.counter, model.header.replaces)
                self._live = slot
                self.model = model
        return status.OK if self.model else status.NO_MODEL

    def _open(self, slot):
        """(status, model) of a slot: signature first, then the tables, then its own vectors."""
        size = self.store.size(NAMES[slot])
        if size <= 0:
            return status.NO_MODEL, None
        code, key = self.keys.signed(self._reader(slot), size)
        if code != status.OK:
            return code, None
        code, model = self._load(slot, key)
        if code == status.OK:
            code = self._self_test(model, slot)
        return code, model if code == status.OK else None

    def _self_test(self, model, slot):
        try:
            return model_image.self_test(model, self._reader(slot), self.feature_count)
        except (OverflowError, ValueError, IndexError):
            return status.OVERFLOW

    def _reader(self, slot):
        store = self.store
        name = NAMES[slot]
        return lambda offset, n: store.read(name, offset, n)

    def _load(self, slot, key):
        body = self.store.size(NAMES[slot]) - slh_dsa.signature_size(key)
        return model_image.load(
            self._reader(slot), body, self.features_version, self.feature_count, self.probe
        )

    def _new_enough(self, header):
        counter = header.counter
        if header.rollback and header.replaces > counter:
            counter = header.replaces
        return status.OK if counter >= self._highest else status.TOO_OLD

    # -- a new model

    def begin(self, size):
        """Make room for an image of `size` bytes in the slot that is not live. A status.

        If an image of that size is already on its way it goes on: `received` says from where.
        """
        if not slh_dsa.available():
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
        self._target = 0 if self._live == _NONE else 1 - self._live
        code = self.store.create(NAMES[self._target])
        if code != status.OK:
            return code
        self.state = RECEIVING
        self.size = size
        self.received = 0
        return status.OK

    def write(self, offset, data):
        """The next piece of the image, or one that was already written (taken as done). A status."""
        if self.state != RECEIVING:
            return status.BAD_STATE
        if offset < 0 or offset > self.received or offset + len(data) > self.size:
            return status.BAD_VALUE
        data = data[self.received - offset :]
        if not data:
            return status.OK
        code = self.store.append(NAMES[self._target], data)
        if code == status.OK:
            self.received += len(data)
        else:
            # how much of the piece arrived is unknown: the store is asked
            self.abort()
        return code

    def verify(self):
        """Is what was received a whole image, signed with our key, for this probe, new enough? A status.

        Anything but OK drops it, except BAD_STATE: before the last piece, or without a begin.
        """
        if self.state >= VERIFIED:
            return status.OK
        if self.state != RECEIVING or self.received != self.size:
            return status.BAD_STATE
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
                    self.abort()
                return code
            code = slh_dsa.verify(self.keys.current, read, self.size)
        if code == status.OK:
            # should it hang, the next start says so; what is live has not been touched
            code = self.store.create(TRIAL, self.store.read(NAMES[slot], 40, 8))
            self.store.sync()
        if code == status.OK:
            code, self.trial = self._load(slot, self.keys.current)
        if self.trial is not None:
            code = self._new_enough(self.trial.header)
        if code != status.OK:
            self.abort()
            return code
        self.state = VERIFIED
        return status.OK

    def try_(self):
        """Run the new model on the vectors it carries; the integers must be those it states. A status."""
        if self.state == TRIED:
            return status.OK
        if self.state != VERIFIED:
            return status.BAD_STATE
        code = self._self_test(self.trial, self._target)
        self.store.remove(TRIAL)
        if code != status.OK:
            self.abort()
            return code
        self.state = TRIED
        return status.OK

    def confirm(self):
        """Make the tried model the live one, for good. A status; on STORE_ERROR the old one stays live."""
        if self.state != TRIED:
            return status.BAD_STATE
        if self.successor:
            code = self.keys.take(self.successor)
            if code == status.OK:
                self.abort()
            return code
        if self.trial is None:
            return status.BAD_STATE
        highest = max(self._highest, self.trial.header.counter)
        code = self.record.save(self._record_of(self._target, self.trial, self.model))
        if code != status.OK:
            return code
        self._live = self._target
        self._highest = highest
        self.health = status.OK
        self.model = self.trial
        self.trial = None
        self.state = IDLE
        return status.OK

    def _record_of(self, slot, model, before):
        """The record with this model live, and another one before it."""
        highest = max(self._highest, model.header.counter)
        b = bytearray(_RECORD)
        b[0] = slot
        for i in range(4):
            b[1 + i] = highest >> 8 * i & 255
        b[5:13] = model.model_id
        if before:
            b[13:21] = before.model_id
        return b

    def abort(self):
        """Drop a model that is on its way; the live one is not touched."""
        if self.state != IDLE:
            self.store.remove(NAMES[self._target])
            if self.store.size(TRIAL) >= 0:
                self.store.remove(TRIAL)
        self.trial = None
        self.successor = b""
        self.state = IDLE
        self.received = 0
        return status.OK

    # -- what is live

    def live(self):
        """The live model, or None."""
        return self.model

    def live_id(self):
        """Its eight bytes, zeros if there is none."""
        return self.model.model_id if self.model else bytes(8)

    def live_size(self):
        """Bytes of the live image, its signature included; 0 if there is none."""
        return self.store.size(NAMES[self._live]) if self.model else 0

    def read(self, offset, n):
        """Bytes of the live image, for reading back."""
        return self.store.read(NAMES[self._live], offset, n) if self.model else b""
