"""The commands that every probe knows; an estimator adds its own (estimator.add_handlers)."""

import gc

from firmware_py import counters, geometry, messages, status, tables

_MASK = counters.MASK
_KNOWN = tuple([command[0] for command in messages.COMMANDS])


def _not_supported(_fields):
    return status.NOT_SUPPORTED, (), b""


def table(probe):
    """Type of a command -> function(fields) -> (status, values, tail), for `commands.Commands`."""
    mine = Handlers(probe)
    known = {}
    for kind in _KNOWN:
        known[kind] = _not_supported  # what this build leaves out
    for kind, handler in (
        (messages.TYPE["identify"], mine.identify),
        (messages.TYPE["get_setting"], mine.get_setting),
        (messages.TYPE["set_setting"], mine.set_setting),
        (messages.TYPE["stream_start"], mine.stream_start),
        (messages.TYPE["stream_stop"], mine.stream_stop),
        (messages.TYPE["statistics"], mine.statistics),
        (messages.TYPE["time_sync"], mine.time_sync),
        (messages.TYPE["stroke_ack"], mine.stroke_ack),
        (messages.TYPE["stream_renew"], mine.stream_renew),
        (messages.TYPE["results"], mine.results),
    ):
        known[kind] = handler
    if probe.estimator:
        probe.estimator.add_handlers(known, probe.begin_measuring)
        for kind in (messages.TYPE["flash_verify"], messages.TYPE["flash_confirm"]):
            known[kind] = mine.between_presses(known[kind])
    return known


class Handlers:
    """The commands of one probe (probe.Probe); each takes its fields and gives status, values and tail."""

    def __init__(self, probe):
        self._probe = probe

    def identify(self, fields):
        probe = self._probe
        probe.results.quiet()
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
            geometry.ROWS,
            geometry.COLUMNS,
            geometry.PITCH_UM,
            geometry.BITS,
            capabilities,
        )
        now = (probe.board.boots, probe.board.ticks_us(), probe.damage(), probe.stream.number)
        return status.OK, values + model + now, b""

    def get_setting(self, fields):
        key = fields[0]
        values = self._probe.settings.values
        if key >= len(values):
            return status.BAD_VALUE, (), b""
        return status.OK, (key, values[key]) + self._probe.settings.limits(key), b""

    def set_setting(self, fields):
        key, value = fields
        return self._probe.settings.set(key, value), (key, value), b""

    def stream_start(self, fields):
        content, every, strokes, lease_ms = fields
        probe = self._probe
        if not content or content & ~(messages.CONTENT_FRAMES | messages.CONTENT_STROKES):
            return status.BAD_VALUE, (), b""
        if lease_ms and not messages.LEASE_LEAST_MS <= lease_ms <= messages.LEASE_MOST_MS:
            return status.BAD_VALUE, (), b""
        if not probe.start_stream(content, every, strokes, lease_ms):
            return status.BUSY, (), b""
        return status.OK, self._where(probe.stream.number) + (probe.stream.lease_ms,), b""

    def stream_stop(self, _fields):
        number = self._probe.stream.number
        self._probe.stop_stream()
        return status.OK, self._where(number), b""

    def stream_renew(self, fields):
        """The asking alone says that the host is still there; it is told where the stream is."""
        probe = self._probe
        if not fields[0] or fields[0] != probe.stream.number:
            return status.NOT_KNOWN, (), b""
        probe.results.wake(fields[0], False)
        return status.OK, self._where(fields[0]) + (probe.stream.lease_ms,), b""

    def _where(self, number):
        probe = self._probe
        return number, probe.acquire.seq, probe.next_stroke, probe.board.ticks_us()

    def between_presses(self, handler):
        """This handler; BUSY while a calibration or a reference press holds on to the live model's tables."""

        def handle(fields):
            return (status.BUSY, (), b"") if self._probe.measuring() else handler(fields)

        return handle

    def results(self, fields):
        results = self._probe.results
        if fields[0]:
            results.wake(fields[0], True)
        return status.OK, (results.waiting(),), results.listed()

    def statistics(self, _fields):
        counts = self._probe.counts
        receiver = self._probe.receiver
        counts[counters.PACKETS_BAD_CRC] = receiver.bad_crc & _MASK
        counts[counters.PACKETS_BAD_FRAME] = receiver.bad_frame & _MASK
        counts[counters.PACKETS_OVERSIZE] = receiver.oversize & _MASK
        counts[counters.ESTIMATES_WAITING] = self._probe.results.waiting()
        counts[counters.FREE_BYTES] = min(gc.mem_free(), _MASK) if hasattr(gc, "mem_free") else 0
        return status.OK, (), counts

    def time_sync(self, _fields):
        return status.OK, (self._probe.received_us, self._probe.board.ticks_us()), b""

    def stroke_ack(self, fields):
        stream, stroke, have = fields
        if not have or have & ~messages.HAVE_ALL:
            return status.BAD_VALUE, (), b""
        missing = self._probe.results.acknowledge(stream, stroke, have)
        if missing < 0:
            return status.NOT_KNOWN, (), b""
        return status.OK, (stream, stroke, missing), b""
