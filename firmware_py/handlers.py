"""What the commands do that every probe knows; an estimator adds its own (estimator.add_handlers)."""

import gc

from firmware_py import counters, messages, status, tables

_PITCH_UM = 1500
_BITS = 12
_MASK = counters.MASK


def _not_supported(_fields):
    return status.NOT_SUPPORTED, (), b""


def table(probe):
    """Type of a command -> function(fields) -> (status, values, tail), for `commands.Commands`."""
    mine = Handlers(probe)
    known = {}
    for command in messages.COMMANDS:
        known[command[0]] = _not_supported  # what this build leaves out
    for name, handler in (
        ("identify", mine.identify),
        ("get_setting", mine.get_setting),
        ("set_setting", mine.set_setting),
        ("stream_start", mine.stream_start),
        ("stream_stop", mine.stream_stop),
        ("statistics", mine.statistics),
        ("time_sync", mine.time_sync),
        ("stroke_ack", mine.stroke_ack),
    ):
        known[messages.TYPE[name]] = handler
    if probe.estimator:
        probe.estimator.add_handlers(known, probe.begin_measuring)
    return known


class Handlers:
    """The commands of one probe (probe.Probe); each takes its fields and gives status, values and tail."""

    def __init__(self, probe):
        self._probe = probe

    def identify(self, fields):
        probe = self._probe
        capabilities = 0
        model = (0, status.NO_MODEL, bytes(8))
        if probe.estimator:
            capabilities, features_version, model_status, model_id = probe.estimator.describe()
            model = (features_version, model_status, model_id)
        values = (
            fields[0],
            tables.PROTOCOL,
            tables.SCHEMA,
            tables.FIRMWARE,
            probe.board.serial,
            messages.ROWS,
            messages.COLUMNS,
            _PITCH_UM,
            _BITS,
            capabilities,
        )
        return status.OK, values + model + (probe.board.boots, probe.board.ticks_us()), b""

    def get_setting(self, fields):
        key = fields[0]
        values = self._probe.settings.values
        if key >= len(values):
            return status.BAD_VALUE, (), b""
        definition = messages.SETTINGS[key]
        return status.OK, (key, values[key], definition[3], definition[4]), b""

    def set_setting(self, fields):
        key, value = fields
        return self._probe.settings.set(key, value), (key, value), b""

    def stream_start(self, fields):
        content, every, strokes = fields
        probe = self._probe
        if not content & (messages.CONTENT_FRAMES | messages.CONTENT_STROKES):
            return status.BAD_VALUE, (), b""
        if not probe.start_stream(content, every, strokes):
            return status.BUSY, (), b""
        return status.OK, (probe.acquire.seq, probe.board.ticks_us()), b""

    def stream_stop(self, _fields):
        probe = self._probe
        probe.stop_stream()
        return status.OK, (probe.acquire.seq, probe.board.ticks_us()), b""

    def statistics(self, _fields):
        counts = self._probe.counts
        receiver = self._probe.receiver
        counts[counters.PACKETS_BAD_CRC] = receiver.bad_crc & _MASK
        counts[counters.PACKETS_BAD_FRAME] = receiver.bad_frame & _MASK
        counts[counters.PACKETS_OVERSIZE] = receiver.oversize & _MASK
        counts[counters.FREE_BYTES] = min(gc.mem_free(), _MASK) if hasattr(gc, "mem_free") else 0
        return status.OK, (), counts

    def time_sync(self, _fields):
        return status.OK, (self._probe.received_us, self._probe.board.ticks_us()), b""

    def stroke_ack(self, fields):
        self._probe.results.acknowledge(fields[0], fields[1])
        return status.OK, fields, b""
