"""When the next frame is due, and reading it: the one path that must allocate nothing."""

from firmware_py import counters, messages, settings, tables

_MASK = counters.MASK


class Acquire:
    """Paces the sensors.

    A frame is begun when it is due and read when the board has measured its cells. `seq` is the next frame's
    number; `time_us`, `position_um`, `displacement_um` are those of the frame that was read last.
    """

    def __init__(self, board, counts, values):
        self._board = board
        self._counts = counts
        self._values = values
        self._more = [getattr(board, name) for name in tables.FRAME_MORE]
        self._due_us = 0
        self._begun_us = 0
        self._begun_um = 0
        self.under_way = False
        self.seq = 0
        self.time_us = 0
        self.position_um = 0
        self.displacement_um = 0

    def start(self, now_us):
        """The first frame is due now; one that is under way is forgotten."""
        self._due_us = now_us
        self.under_way = False

    def wait_us(self, now_us):
        """Time until the next frame is due (0 or less: now)."""
        return counters.elapsed(self._due_us, now_us)

    def begin(self, now_us):
        """A frame of now: its place is read, its cells begin to be measured."""
        period_us = 1000000000 // self._values[settings.FRAME_RATE]
        late_us = counters.elapsed(now_us, self._due_us)
        if late_us >= period_us:
            counters.add(self._counts, counters.FRAMES_OVERRUN, late_us // period_us)
            self._due_us = now_us
        self._due_us = (self._due_us + period_us) & _MASK
        self._begun_us = now_us
        self._begun_um = self._board.position_um()
        self._board.start_scan()
        self.under_way = True

    def read(self, body, counts):
        """Read the frame under way into body (its head) and counts (a view of the bytes behind it)."""
        board = self._board
        self.time_us = self._begun_us
        self.position_um = self._begun_um
        self.displacement_um = board.displacement_um()
        board.scan(counts)
        self.under_way = False
        messages.put_frame_head(body, self.seq, self.time_us, self.position_um, self.displacement_um)
        for k in range(len(self._more)):
            messages.put_frame_more(body, k, self._more[k]())
        self.seq = (self.seq + 1) & _MASK
        counters.add(self._counts, counters.FRAMES_ACQUIRED, 1)
