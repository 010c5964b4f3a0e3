"""What waits for the link: whole frames, the oldest of which make room, and messages, which go first.

All memory is taken at the start. One packet at a time is encoded and handed to the board piece by piece,
as the link takes it; a packet that has begun is finished.
"""

from array import array

from firmware_py import counters, messages, wire

MESSAGE_BODY = 320  # the longest message that is not a frame
SHORT = 112  # most are no longer than this, estimates among them
_CRC = 4

_FRAMES_SENT = counters.FRAMES_SENT
_FRAMES_DROPPED = counters.FRAMES_DROPPED
_MESSAGES_SENT = counters.MESSAGES_SENT
_BYTES_SENT = counters.BYTES_SENT


class Outbox:
    """Preallocated bodies, a ring of frames and a queue of messages, and one wire buffer.

    Parameters: counts (the probe's counters); frames, short, long: how many may wait of frames, of messages
    up to SHORT bytes, and of any messages.
    `body` is where a message is packed before it is queued.
    """

    def __init__(self, counts, frames=4, short=7, long=3):
        self._counts = counts
        self.body = bytearray(MESSAGE_BODY)
        # one more frame than may wait: the one that the sensors are being read into
        self._frames = [bytearray(messages.FRAME_BODY + _CRC) for _ in range(frames + 1)]
        self._views = [memoryview(f)[messages.FRAME_HEAD : messages.FRAME_BODY] for f in self._frames]
        self._frame_lengths = array("H", [0] * (frames + 1))
        self._first = 0
        self.frames_waiting = 0
        self._bodies = [bytearray(SHORT + _CRC) for _ in range(short)]
        self._bodies += [bytearray(MESSAGE_BODY + _CRC) for _ in range(long)]
        self._lengths = array("H", [0] * (short + long))  # 0: free
        self._free_short = short
        self._free_long = long
        self._queue = bytearray(short + long)  # which bodies wait, in their order
        self._head = 0
        self.messages_waiting = 0
        self._wire = bytearray(wire.wire_size(max(messages.FRAME_BODY, MESSAGE_BODY)))
        self._wire[0] = 0
        self._at = 0
        self._end = 0

    def room(self, length=MESSAGE_BODY):
        """How many more messages of this length fit."""
        return self._free_long + (self._free_short if length <= SHORT else 0)

    def idle(self):
        """True if nothing waits."""
        return self._at >= self._end and not self.frames_waiting and not self.messages_waiting

    def frame(self):
        """The body to write the next frame into."""
        return self._frames[(self._first + self.frames_waiting) % len(self._frames)]

    def counts(self):
        """A view of the packed counts in `frame()`."""
        return self._views[(self._first + self.frames_waiting) % len(self._frames)]

    def commit_frame(self, length):
        """Queue what was written into `frame()`; the oldest waiting frame makes room and is counted."""
        size = len(self._frames)
        self._frame_lengths[(self._first + self.frames_waiting) % size] = length
        if self.frames_waiting == size - 1:
            self._first = (self._first + 1) % size
            counters.add(self._counts, _FRAMES_DROPPED, 1)
        else:
            self.frames_waiting += 1

    def drop_frames(self):
        """Forget the frames that wait (a new stream begins); counted."""
        counters.add(self._counts, _FRAMES_DROPPED, self.frames_waiting)
        self.frames_waiting = 0

    def post(self, body, length, at=0):
        """Queue a copy of body[at:at + length]; True if there was room."""
        n = len(self._bodies)
        for k in range(n):
            if not self._lengths[k] and length + _CRC <= len(self._bodies[k]):
                self._bodies[k][:length] = memoryview(body)[at : at + length]
                self._lengths[k] = length
                self._count(k, -1)
                self._queue[(self._head + self.messages_waiting) % n] = k
                self.messages_waiting += 1
                return True
        return False

    def _count(self, k, change):
        """Body k is free again, or no longer."""
        if len(self._bodies[k]) > SHORT + _CRC:
            self._free_long += change
        else:
            self._free_short += change

    def _load(self):
        """Encode what goes next into the wire buffer; False if nothing waits."""
        if self.messages_waiting:
            k = self._queue[self._head]
            self._head = (self._head + 1) % len(self._bodies)
            self.messages_waiting -= 1
            self._end = wire.seal(self._bodies[k], self._lengths[k], self._wire, 1)
            self._lengths[k] = 0
            self._count(k, 1)
            self._at = 0
            counters.add(self._counts, _MESSAGES_SENT, 1)
        elif self.frames_waiting:
            k = self._first
            self._first = (k + 1) % len(self._frames)
            self.frames_waiting -= 1
            self._end = wire.seal(self._frames[k], self._frame_lengths[k], self._wire, 1)
            self._at = 1  # a frame has no zero in front
            counters.add(self._counts, _FRAMES_SENT, 1)
        else:
            return False
        return True

    def pump(self, board):
        """Give the link what it takes now. Allocates nothing."""
        while self._at < self._end or self._load():
            n = board.write(self._wire, self._at, self._end)
            if n <= 0:
                return
            self._at += n
            counters.add(self._counts, _BYTES_SENT, n)
            if self._at < self._end:
                return
