"""The identity of a probe: its handshake, and whether it speaks our protocol."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from firmware_py import geometry, messages, status, tables
from palpate.array import words_of
from palpate.errors import VersionMismatch
from palpate.wire.damage import damage_words

CAPABILITIES = {
    messages.CAN_FLASH: "flash",
    messages.CAN_CALIBRATE: "calibrate",
    messages.TAKES_REFERENCE: "takes_reference",
    messages.HOLDS_REFERENCE: "holds_reference",
}


@dataclass(frozen=True)
class Identity:
    """What a probe reports about itself (docs/protocol.md, "Handshake").

    Parameters
    ----------
    protocol, schema : int
        Version and hash of the message tables.
    firmware : str
        Version of the firmware.
    serial : str
        The board's serial number, hexadecimal.
    rows, columns, pitch_mm, bits : int, int, float, int
        The sensors: along the stroke, across it, their pitch and the ADC's bits.
    capabilities : tuple of str
        Of flash, calibrate, takes_reference (its model does), holds_reference (there is one).
    features_version : int
        Version of the feature list.
    model_status : int
        0, or why there is no model (`firmware_py.status`).
    model_id : str
        First 8 bytes of the live model's hash, hexadecimal.
    boots : int
        How often the probe has started.
    time_us : int
        Its clock, modulo 2^30.
    damaged : tuple of str
        What it found damaged in its store: calibration, model record, settings.
    stream : int
        The stream that runs on it, 0 where none does.
    """

    protocol: int
    schema: int
    firmware: str
    serial: str
    rows: int
    columns: int
    pitch_mm: float
    bits: int
    capabilities: tuple[str, ...]
    features_version: int
    model_status: int
    model_id: str
    boots: int
    time_us: int
    damaged: tuple[str, ...] = ()
    stream: int = 0

    @classmethod
    def from_answer(cls, values: tuple[Any, ...]) -> Identity:
        """From the fields of an identify answer (its nonce first)."""
        (_, protocol, schema, firmware, serial, rows, columns, pitch_um, bits) = values[:9]
        capabilities, features_version, model_status, model_id, boots, time_us, damage, stream = values[9:]
        able = tuple(word for bit, word in CAPABILITIES.items() if capabilities & bit)
        return cls(
            protocol,
            schema,
            version_words(firmware),
            serial.hex(),
            rows,
            columns,
            pitch_um / 1000,
            bits,
            able,
            features_version,
            model_status,
            model_id.hex() if any(model_id) else "",
            boots,
            time_us,
            tuple(damage_words(damage)),
            stream,
        )

    @property
    def array(self) -> str:
        """The array's name, as `firmware_py.geometry` gives it."""
        return geometry.name(self.rows, self.columns, round(1000 * self.pitch_mm))

    @property
    def has_model(self) -> bool:
        """True where a confirmed model is live."""
        return self.model_status == status.OK and bool(self.model_id)

    def as_dict(self) -> dict[str, Any]:
        """The identity as `--json` prints it: the schema in hexadecimal, the model's status in words."""
        words = asdict(self)
        words["schema"] = f"{self.schema:08x}"
        words["model_status"] = status.TEXT.get(self.model_status, str(self.model_status))
        return words

    def differences(self) -> dict[str, tuple[str, str]]:
        """Where probe and host differ: name -> the probe's value, this program's value."""
        told = {
            "protocol version": (f"{self.protocol}", f"{tables.PROTOCOL}"),
            "array": (self.array, geometry.NAME.decode()),
            "firmware": (self.firmware, version_words(tables.FIRMWARE)),
        }
        found = {name: pair for name, pair in told.items() if pair[0] != pair[1]}
        return found if set(found) - {"firmware"} else {}

    def check(self) -> None:
        """Raise `VersionMismatch` unless probe and host speak the same protocol.

        Another firmware or schema alone is no obstacle: within a protocol version things are only added
        (docs/protocol.md, "Versions").
        """
        found = self.differences()
        if not found:
            return
        what = ", ".join(f"{name} {theirs} (here {ours})" for name, (theirs, ours) in found.items())
        if "firmware" not in found:
            what += f", both firmware {self.firmware}"
        raise VersionMismatch(
            f"the probe does not speak this program's protocol: {what}; {self._todo()}", tuple(found)
        )

    def _todo(self) -> str:
        if self.array != geometry.NAME.decode():
            words = words_of(self.rows, self.columns, self.pitch_mm)
            return f"name its array, as with --array {words} (docs/howto/another-array.md)"
        probe = (self.protocol, *map(int, self.firmware.split(".")))
        if probe > (tables.PROTOCOL, *tables.FIRMWARE):
            return "the probe is the newer one: update this program with pip install -U palpate"
        return "install this program's firmware on the probe (docs/firmware.md, Onto the board)"


def version_words(version: bytes) -> str:
    """Three bytes as 1.2.3."""
    return ".".join(str(part) for part in version)
