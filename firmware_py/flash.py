"""The commands that bring a new model: begin, data, verify, confirm, abort; the work is done in slots.py."""

from firmware_py import features, keyring, memory, messages, slots, status


class Flash:
    """A probe's model slots and their commands.

    Parameters: store (store.py), key: the public key (signature.py) whose signature makes a model believable.
    """

    def __init__(self, store, key):
        self.slots = slots.Slots(store, key, features.FEATURES_VERSION, features.COUNT)
        self.status = self.slots.boot()
        self.slots.settle()
        memory.forget(memory.FLASHING)
        self._name = b""  # what the host calls the image that is on its way, or that came last
        self._refused = status.BAD_STATE  # why that one was dropped

    def live(self):
        """The live model or None, and OK or the reason why there is none."""
        model = self.slots.live()
        return model, status.OK if model else self.status or status.NO_MODEL

    def read_live(self, offset, n):
        """Size of the live image (-1: none) and up to n bytes of it."""
        size = self.slots.live_size()
        if size <= 0:
            return -1, b""
        return size, self.slots.read(offset, n)

    def add_handlers(self, table, take_model):
        """Add the commands to the probe's table; `take_model` is called when the live model is another."""
        self.slots.changed = take_model
        table[messages.TYPE["flash_begin"]] = self._begin
        table[messages.TYPE["flash_data"]] = self._data
        table[messages.TYPE["flash_verify"]] = self._verify
        table[messages.TYPE["flash_confirm"]] = self._confirm
        table[messages.TYPE["flash_abort"]] = self._abort

    def _begin(self, fields):
        size, name = fields
        if name != self._name:
            self.slots.abort()  # what is on its way is another image, though it may have the same size
            self._name = name
        self._refused = status.BAD_STATE
        code = self.slots.begin(size)
        memory.forget(memory.FLASHING)
        return code, (self.slots.received,), b""

    def _data(self, fields):
        offset, data = fields
        if not data:
            return status.BAD_LENGTH, (), b""
        return self.slots.write(offset, data), (self.slots.received,), b""

    def _verify(self, fields):
        if fields[0] != self._name:
            return status.BAD_VALUE, (), b""
        if self.slots.state == slots.IDLE:
            return self._refused, (), b""  # asked again, after an answer that was lost
        code = self.slots.verify()
        if code == status.OK:
            code = self.slots.try_()
        memory.forget(memory.FLASHING)
        if code != status.OK:
            if self.slots.state == slots.IDLE:
                self._refused = code
            return code, (), b""
        return code, (self.slots.trial_id or keyring.name(self.slots.successor[keyring.MOMENT :]),), b""

    def _confirm(self, fields):
        code = self._go_live(fields[0])
        memory.forget(memory.FLASHING)
        return code, (self.slots.live_id(),), b""

    def _go_live(self, model_id):
        """Make the model with this id the live one; done where it is, so that it may be asked again."""
        if self.slots.successor and keyring.name(self.slots.successor[keyring.MOMENT :]) == model_id:
            return self.slots.confirm()
        if self.slots.state == slots.IDLE and keyring.name(self.slots.keys.current) == model_id:
            return status.OK
        if self.slots.trial_id != model_id:
            live = self.slots.model is not None and self.slots.live_id() == model_id
            return status.OK if live and self.slots.state == slots.IDLE else status.BAD_STATE
        return self.slots.confirm()

    def _abort(self, _fields):
        code = self.slots.abort()
        memory.forget(memory.FLASHING)
        return code, (self.slots.live_id(),), b""
