"""The commands that bring a new model: begin, data, verify, confirm, abort; the work is done in slots.py."""

from firmware_py import features, messages, slots, status


class Flash:
    """A probe's model slots and their commands.

    Parameters: store (store.py), key: the public key (56 bytes) whose signature makes a model believable.
    """

    def __init__(self, store, key):
        self.slots = slots.Slots(store, key, features.FEATURES_VERSION, features.COUNT)
        self.status = self.slots.boot()

    def live(self):
        """The live model or None, and OK or why there is none."""
        model = self.slots.live()
        return model, status.OK if model else self.status

    def read_live(self, offset, n):
        """Size of the live image (-1: none) and up to n bytes of it."""
        size = self.slots.live_size()
        if size <= 0:
            return -1, b""
        return size, self.slots.read(offset, n)

    def add_handlers(self, table, take_model):
        """Add the commands to the probe's table; `take_model` is called when another model went live."""

        def confirm(_fields):
            code = self.slots.confirm()
            if code == status.OK:
                take_model()
            return code, (self.slots.live_id(),), b""

        table[messages.TYPE["flash_begin"]] = self._begin
        table[messages.TYPE["flash_data"]] = self._data
        table[messages.TYPE["flash_verify"]] = self._verify
        table[messages.TYPE["flash_confirm"]] = confirm
        table[messages.TYPE["flash_abort"]] = self._abort

    def _begin(self, fields):
        return self.slots.begin(fields[0]), (self.slots.received,), b""

    def _data(self, fields):
        offset, data = fields
        if not data:
            return status.BAD_LENGTH, (), b""
        return self.slots.write(offset, data), (self.slots.received,), b""

    def _verify(self, _fields):
        code = self.slots.verify()
        if code == status.OK:
            code = self.slots.try_()
        trial = self.slots.trial
        if code != status.OK or trial is None:
            return code, (), b""
        return code, (trial.model_id,), b""

    def _abort(self, _fields):
        return self.slots.abort(), (self.slots.live_id(),), b""
