"""What can go wrong, as a tree; every leaf's text is one sentence that says what to do.

    PalpateError                      exit status 1: the work failed
      UsageError        (ValueError)  exit status 2: invalid arguments
        UnknownFormat                 a file's suffix says nothing to us
        NoSuchFile                    a file that should be read is not there
      MissingExtra                    an optional package is not installed
      LinkError
        PortError
          PortMissing                 no such port, or the probe is unplugged
          PortBusy                    another program holds it (`.holder` says which)
          PortForbidden               we may not open it (`.group` says whom to join)
          PortAmbiguous               `auto` found several probes
        LinkGone                      the port vanished while it was open
        NotAProbe                     bytes come, or none, but no handshake
        VersionMismatch               probe and host speak different protocols (`.names` says where)
        NotLive                       a recording takes no commands
        Contradiction                 what the probe answers cannot be
        CommandTimeout                no answer after all retries
        CommandRefused                the probe answered with an error (`.status`)
      FlashError
        ImageRefused                  the probe refused the model image; the old model stays
        ImageUnreadable (UsageError)  the file is no sound model image; nothing was sent
      RecordingError
        NotARecording   (UsageError)  the file is not a Palpate recording
        DiskFull                      the disk is full; what was written is kept
        ReplayDiffers                 the recording's estimate and its replay are not equal

The other rooms hang their own trees on the same root: `palpate.sim.tissue.errors` (TissueError),
`palpate.model_export.errors` (ExportError). This module imports nothing, so that every room may import it.
"""

from __future__ import annotations


class PalpateError(Exception):
    """Root of everything that Palpate raises on purpose; the text is one sentence that says what to do."""

    exit_status = 1


class UsageError(PalpateError, ValueError):
    """Invalid arguments: a name, a number or an option that makes no sense."""

    exit_status = 2


class UnknownFormat(UsageError):
    """A file's suffix names no format that can be written or read."""


class NoSuchFile(UsageError):
    """A file that should be read is not there or cannot be read."""


class MissingExtra(PalpateError):
    """An optional package is missing.

    Parameters
    ----------
    package, extra : str
        What to import, and the extra of the distribution `palpate` that brings it.
    purpose : str
        What it is needed for, as "writing HDF5".
    """

    def __init__(self, package: str, extra: str, purpose: str) -> None:
        super().__init__(f"{purpose} needs {package}; install it with: pip install 'palpate[{extra}]'")
        self.package, self.extra = package, extra


class LinkError(PalpateError):
    """Something between host and probe."""


class PortError(LinkError):
    """The port could not be opened."""

    def __init__(self, port: str, message: str) -> None:
        super().__init__(message)
        self.port = port


class PortMissing(PortError):
    """There is no such port, or no probe on any."""


class PortBusy(PortError):
    """Another program holds the port; `holder` is "name (process 123)" where the system tells."""

    def __init__(self, port: str, message: str, holder: str | None = None) -> None:
        super().__init__(port, message)
        self.holder = holder


class PortForbidden(PortError):
    """The user may not open the port; `group` is the one to join, where the system tells."""

    def __init__(self, port: str, message: str, group: str | None = None) -> None:
        super().__init__(port, message)
        self.group = group


class PortAmbiguous(PortError):
    """`auto` found more than one probe; `candidates` are their ports."""

    exit_status = 2

    def __init__(self, port: str, message: str, candidates: tuple[str, ...]) -> None:
        super().__init__(port, message)
        self.candidates = candidates


class LinkGone(LinkError):
    """The port vanished while it was open: unplugged, or the other end closed."""


class NotAProbe(LinkError):
    """The other end does not answer the handshake."""


class VersionMismatch(LinkError):
    """Probe and host disagree on the protocol.

    `names` says where: "protocol version", "schema" (the hash of all message tables), "cells", "firmware".
    """

    def __init__(self, message: str, names: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.names = names


class NotLive(LinkError):
    """The source is a recording: it can be read, not commanded."""


class Contradiction(LinkError):
    """The probe's answers contradict each other, or what a probe can be; it is not followed any further."""


class CommandTimeout(LinkError):
    """A command got no answer, however often it was sent."""


class CommandRefused(LinkError):
    """The probe answered a command with an error.

    Parameters
    ----------
    command : str
        Name of the command.
    status : int
        The code of `firmware_py.status`.
    reason : str
        Its sentence.
    """

    def __init__(self, command: str, status: int, reason: str) -> None:
        super().__init__(f"the probe refused {command}: {reason} (status {status})")
        self.command, self.status, self.reason = command, status, reason


class FlashError(PalpateError):
    """A model did not get onto the probe."""


class ImageRefused(FlashError):
    """The probe refused the model image and keeps its old model; `status` says why."""

    def __init__(self, message: str, status: int = 0) -> None:
        super().__init__(message)
        self.status = status


class ImageUnreadable(FlashError, UsageError):
    """The file is not a sound model image; nothing was sent to the probe."""

    exit_status = 2


class RecordingError(PalpateError):
    """Something with a recording's file."""


class NotARecording(RecordingError, UsageError):
    """The file is no Palpate recording."""

    exit_status = 2


class DiskFull(RecordingError):
    """The disk is full; everything up to the last complete frame is kept."""


class ReplayDiffers(RecordingError):
    """Replaying the frames gave another estimate than the probe sent."""
