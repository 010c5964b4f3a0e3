"""The model that is live, and the record that says so: two slots, of which one is live at most.

The live slot is never written. Nothing has to be undone at a start: `boot` only reads, so it may itself be
cut as often as one likes. `settle`, after it, repairs what had rotted. slots.py receives a new model.

What checks and loads a model is imported where it is called: a board has no room for it at other times
(memory.forget). Nor has it room for the tables of two models: the live one is set aside while another is
tried, and then read again from its slot.
"""

from firmware_py import keyring, memory, safe_record, status

NAMES = ("model0", "model1")
TRIAL = "trial"  # there while a model is being tried: its id
RECORD_BYTES = 21  # live slot (1), highest counter (4), id of the live model (8) and of the one before it (8)

_NONE = 255


def _nobody():
    pass


class LiveModel:
    """The live model of a probe.

    Parameters: the store; the public key that signs models (signature.py); what this firmware
    computes (features_version, feature_count); the probe's identity (model_image.PROBE).
    `model` is the live model (evaluator.Model) or None. `changed` is called whenever it is another one, or
    for a while none: nobody may hold on to the tables of the one before. After `boot`, `health` is OK or the
    worst of REPAIRED, ROTTEN and TRIAL_HUNG (status.py).
    """

    def __init__(self, store, key, features_version, feature_count, probe):
        self.store = store
        self.keys = keyring.Keyring(store, key)
        self.health = status.OK
        self.features_version = features_version
        self.feature_count = feature_count
        self.probe = probe
        self.record = safe_record.Record(store, "live")
        self.model = None
        self._live = _NONE
        self._highest = 0
        self.changed = _nobody
        self._aside = None  # id of the model that is set aside, and its reference
        self._reference = ()

    def spare(self):
        """The slot that is not live."""
        return 0 if self._live == _NONE else 1 - self._live

    def boot(self):
        """Find the live model: OK with `model` set, or NO_MODEL. Reads only.

        The slot that the record names comes first. Should it be damaged, the other one serves if it is
        the model that was live before, or new enough to be flashed. Should the record be damaged beyond
        repair, the slots themselves say which model is the newest, so that the counter does not fall.
        """
        self.model = None
        self._live = _NONE
        self._highest = 0
        self.health = status.TRIAL_HUNG if self.store.size(TRIAL) > 0 else status.OK
        self._note(self.keys.load())
        kept = self.record.load()
        self._note(self.record.state)
        if kept is None or len(kept) != RECORD_BYTES or self.record.state == status.ROTTEN:
            # gone, or never there: with nothing left of it, nothing in the slots was ever confirmed
            return self._recover() if self.health == status.ROTTEN else status.NO_MODEL
        self._highest = int.from_bytes(kept[1:5], "little")
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
        if code == status.OK and (model.model_id == kept[13:21] or self._new_enough(model) == status.OK):
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
            if code == status.OK and self._new_enough(model) == status.OK:
                self._highest = max(model.counter, model.replaces)
                self._live = slot
                self.model = model
        return status.OK if self.model else status.NO_MODEL

    def _open(self, slot):
        """(status, model) of a slot: signature first, then the tables, then its own vectors."""
        size = self.store.size(NAMES[slot])
        if size <= 0:
            return status.NO_MODEL, None
        code, body = self._signed(slot, size)
        if code != status.OK:
            return code, None
        code, model = self._load(slot, body)
        if code == status.OK:
            code = self._self_test(model, slot)
        return code, model if code == status.OK else None

    def _signed(self, slot, size, stays=True):
        """(status, bytes before the signature) of a slot; stays: see keyring.Keyring.signed."""
        try:
            return self.keys.signed(self._reader(slot), size, stays)
        except MemoryError:
            return status.NO_SPACE, 0

    def _self_test(self, model, slot):
        from firmware_py import model_image

        try:
            return model_image.self_test(model, self._reader(slot), self.feature_count)
        except (OverflowError, ValueError, IndexError):
            return status.OVERFLOW
        except MemoryError:
            return status.NO_SPACE

    def _reader(self, slot):
        store = self.store
        name = NAMES[slot]
        return lambda offset, n: store.read(name, offset, n)

    def _load(self, slot, body):
        """(status, model) of a slot whose signature is good; `body` bytes stand before it."""
        memory.give_back(memory.SIGNATURE)
        from firmware_py import model_image

        return model_image.load(
            self._reader(slot), body, self.features_version, self.feature_count, self.probe
        )

    def _new_enough(self, model):
        counter = model.counter
        if model.rollback and model.replaces > counter:
            counter = model.replaces
        return status.OK if counter >= self._highest else status.TOO_OLD

    def _record_of(self, slot, model, before):
        """The record with this model live, and the one with the id `before` (or None) before it."""
        highest = max(self._highest, model.counter)
        b = bytearray(RECORD_BYTES)
        b[0] = slot
        for i in range(4):
            b[1 + i] = highest >> 8 * i & 255
        b[5:13] = model.model_id
        if before:
            b[13:21] = before
        return b

    def _make_live(self, slot, model):
        """Put this model, which lies in `slot`, in the live one's place for good. A status."""
        before = self.model.model_id if self.model else self._aside
        code = self.record.save(self._record_of(slot, model, before))
        if code == status.OK:
            self._highest = max(self._highest, model.counter)
            self._live = slot
            self.health = status.OK
            self.model = model
            self._aside = None
            self.changed()
        return code

    def set_aside(self):
        """The live model's tables make room for another's."""
        if self.model:
            first = self.model.first
            self._aside = self.model.model_id
            self._reference = tuple(first.reference) if first and first.held else ()
            self.model = None
            self.changed()

    def take_back(self):
        """Read, and check, the live model that was set aside once more; nothing happens if none was."""
        if self.model or not self._aside:
            return
        code, self.model = self._open(self._live)
        if self.model and self._reference:
            self.model.first.set(*self._reference)
        if code != status.OK and code != status.NO_SPACE:
            self._note(status.ROTTEN)
        self.changed()

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
