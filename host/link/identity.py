"""Who answers at the other end: the handshake, and whether we speak the same protocol."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from firmware_py import messages, status
from host.errors import VersionMismatch

CAPABILITIES = {
    messages.CAN_FLASH: "flash",
    messages.CAN_CALIBRATE: "calibrate",
}


@dataclass(frozen=True)
class Identity:
    """What a probe says of itself (docs/protocol.md, "Handshake").

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
        Of flash, calibrate.
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

    @classmethod
    def from_answer(cls, values: tuple[Any, ...]) -> Identity:
        """From the fields of an identify answer (its nonce first)."""
        (_, protocol, schema, firmware, serial, rows, columns, pitch_um, bits) = values[:9]
        capabilities, features_version, model_status, model_id, boots, time_us = values[9:]
        able = tuple(word for bit, word in CAPABILITIES.items() if capabilities & bit)
        return cls(
            protocol,
            schema,
            ".".join(str(part) for part in firmware),
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
        )

    @property
    def has_model(self) -> bool:
        """True where a confirmed model is live."""
        return self.model_status == status.OK and bool(self.model_id)

    def as_dict(self) -> dict[str, Any]:
        words = asdict(self)
        words["schema"] = f"{self.schema:08x}"
        words["model_status"] = status.TEXT.get(self.model_status, str(self.model_status))
        return words

    def check(self) -> None:
        """Raise `VersionMismatch` unless probe and host speak the same protocol."""
        if self.protocol != messages.PROTOCOL:
            newer = "host" if self.protocol < messages.PROTOCOL else "probe"
            older = (
                "probe's firmware (docs/firmware.md)" if newer == "host" else "host (pip install -U palpate)"
            )
            raise VersionMismatch(
                f"the probe speaks protocol {self.protocol} and this program {messages.PROTOCOL}; "
                f"update the {older}",
                ("protocol",),
            )
        if self.schema != messages.SCHEMA:
            raise VersionMismatch(
                f"the probe's message tables (schema {self.schema:08x}, firmware {self.firmware}) are not "
                f"this program's (schema {messages.SCHEMA:08x}); "
                "install the firmware that came with this version of palpate",
                ("schema",),
            )
        if (self.rows, self.columns) != (messages.ROWS, messages.COLUMNS):
            raise VersionMismatch(
                f"the probe has {self.rows} x {self.columns} cells and this program reads "
                f"{messages.ROWS} x {messages.COLUMNS}; see docs on other probe geometries",
                ("rows", "columns"),
            )
