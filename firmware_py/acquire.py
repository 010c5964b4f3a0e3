"""When the next frame is due, and reading it: the one path that must allocate nothing."""

from firmware_py import counters, messages, settings

_MASK = counters.MASK


class Acquire:
    """Paces the sensors.

    `seq` is the next frame's number; `time_us`, `position_um`, `displacement_um` are the last frame's.
    """

    def __init__(self, board, counts, values):
        self._board = board
        self._counts = counts
        self._values = values
        self._due_us = 0
        self.seq = 0
        self.time_us = 0
        self.position_um = 0
        self.displacement_um = 0

    def start(self, now_us):
        """The first frame is due now."""
        self._due_us = now_us

    def wait_us(self, now_us):
        """Time until the next frame is due (0 or less: now)."""
        return counters.elapsed(self._due_us, now_us)

    def read(self, body, counts, now_us):
        """Read one frame into body (its head) and counts (a view of the 624 bytes behind it)."""
        period_us = 1000000000 // self._values[settings.FRAME_RATE]
        late_us = counters.elapsed(now_us, self._due_us)
        if late_us >= period_us:
            counters.add(self._counts, counters.FRAMES_OVERRUN, late_us // period_us)
            self._due_us = now_us
        self._due_us = (self._due_us + period_us) & _MASK
        board = self._board
        self.time_us = now_us
        self.position_um = board.position_um()
        self.displacement_um = board.displacement_um()
        board.scan(counts)
        messages.put_frame_head(body, self.seq, now_us, self.position_um, self.displacement_um)
        self.seq = (self.seq + 1) & _MASK
        counters.add(self._counts, counters.FRAMES_ACQUIRED, 1)
