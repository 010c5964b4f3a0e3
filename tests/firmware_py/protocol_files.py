"""Writes what is derived from firmware_py/tables.py: SCHEMA, docs/protocol.md's tables, the
C header, tests/vectors/protocol.

    python -m tests.firmware_py.protocol_files

`test_protocol_files.py` fails while they do not agree.
"""

import binascii
import json
import random
import re
import struct
from pathlib import Path

from firmware_py import geometry, messages, status, tables, wire
from palpate.link import devices, line, patience, remote, stream_wish
from palpate.link import flash as flashing
from tests.firmware_py import c_header, protocol_session
from tests.firmware_py.c_header import fields_of
from tests.firmware_py.protocol_words import DAMAGE, meaning_of

ROOT = Path(__file__).parent.parent.parent
PAGE = ROOT / "docs" / "protocol.md"
TABLES = ROOT / "firmware_py" / "tables.py"
HEADER = ROOT / "docs" / "examples" / "c" / "palpate.h"
VECTORS = ROOT / "tests" / "vectors" / "protocol"
KINDS = {"B": "u8", "b": "i8", "H": "u16", "I": "u32", "i": "i32", "3s": "3 bytes", "8s": "8 bytes"}


def schema() -> int:
    return binascii.crc32(tables.schema_text().encode())


def message_rows(definitions) -> str:
    rows = ["| type | name | fields |", "|---|---|---|"]
    for kind, name, fields, names, tail in definitions:
        cells = [f"`{n}` {KINDS[f]}" for n, f in zip(names.split(), fields_of(fields), strict=True)]
        if tail:
            cells.append({"B": "then bytes to the end", "i": "then i32 to the end"}[tail])
        rows.append(f"| 0x{kind:02X} | {name} | {', '.join(cells) or '(none)'} |")
    return "\n".join(rows)


def field_rows(definitions) -> str:
    """What each field means."""
    rows = ["| message | field | unit | meaning |", "|---|---|---|---|"]
    for _, name, _, names, tail in definitions:
        head = name
        for word in [*names.split(), *(["tail"] if tail else [])]:
            unit, meaning = meaning_of(f"{name}.{word}")
            shown = "(the rest)" if word == "tail" else f"`{word}`"
            rows.append(f"| {head} | {shown} | {unit} | {meaning} |")
            head = ""
    return "\n".join(rows)


def status_rows() -> str:
    rows = ["| code | name | meaning |", "|---|---|---|"]
    for code in sorted(c_header.STATUS_NAMES, reverse=True):
        rows.append(f"| {code} | {c_header.STATUS_NAMES[code]} | {status.TEXT[code]} |")
    return "\n".join(rows)


def damage_rows() -> str:
    """Every bit of `damage`."""
    bits = {name: value for name, value in vars(messages).items() if name.startswith("DAMAGE")}
    rows = ["| bit | name | what was damaged, and what that means |", "|---|---|---|"]
    rows += [f"| {bit} | {name} | {DAMAGE[name]} |" for name, bit in bits.items()]
    return "\n".join(rows)


def time_rows() -> str:
    """How long everybody waits, out of the constants of both ends."""
    again, most = patience.SHORTEST_WAIT_S, patience.FIRST_WAIT_S
    least, longest = messages.LEASE_LEAST_MS / 1000, messages.LEASE_MOST_MS / 1000
    times = (
        ("an answer, before the same bytes are sent again: at first", f"{most:g} s", "host"),
        ("later four round trips, but between", f"{again:g} and {most:g} s", "host"),
        ("each further wait is longer by", f"{patience.GROWTH:g}", "host"),
        ("an answer at all", f"{line.GIVE_UP_S:g} s", "host"),
        (
            "to flash_verify and flash_confirm (it is verified and tried)",
            f"{flashing.VERIFY_TIMEOUT_S:g} s",
            "host",
        ),
        ("to read_back", f"{remote.READ_BACK_S:g} s", "host"),
        ("to calibrate, reference: 1.5 times what frames take, and", f"{remote.CALIBRATE_S:g} s", "host"),
        ("between two tries of what the probe was BUSY for", f"{remote.BUSY_WAIT_S:g} s", "host"),
        ("for an unplugged probe to come back, with a command", f"{line.AWAY_S:g} s", "host"),
        ("between two stream_renew", f"{stream_wish.RENEW_S:g} s", "host"),
        ("the lease that our host asks for", f"{stream_wish.LEASE_MS / 1000:g} s", "host"),
        (
            "the lease of a host that asks for 0, and of a calibration",
            f"{messages.LEASE_MS / 1000:g} s",
            "probe",
        ),
        ("shortest and longest lease", f"{least:g} and {longest:g} s", "probe"),
        ("for an acknowledgement; then twice as long, and so on", "`resend_results`", "probe"),
    )
    return "\n".join(
        [
            "| what is waited for | time | by |",
            "|---|---|---|",
            *(f"| {a} | {b} | {c} |" for a, b, c in times),
        ]
    )


def usb_rows() -> str:
    rows = ["| vendor:product | what |", "|---|---|"]
    rows += [f"| {vendor:04x}:{product:04x} | {name} |" for (vendor, product), name in devices.BOARDS.items()]
    return "\n".join(rows)


def session_rows() -> str:
    """The session, byte by byte; of long packets the beginning."""
    rows = ["| from | bytes | what they say |", "|---|---|---|"]
    for sender, data, words in protocol_session.session():
        shown = data.hex(" ") if len(data) <= 32 else f"{data[:24].hex(' ')} ... ({len(data)} bytes)"
        rows.append(f"| {sender} | `{shown}` | {words} |")
    return "\n".join(rows)


def setting_rows() -> str:
    rows = ["| key | name | unit | lowest | highest | default |", "|---|---|---|---|---|---|"]
    rows += ["| " + " | ".join(str(x) for x in setting) + " |" for setting in messages.SETTINGS]
    return "\n".join(rows)


def page_tables() -> dict[str, str]:
    """What belongs between the page's markers `<!-- NAME -->` and `<!-- / -->`."""
    return {
        "commands": message_rows(messages.COMMANDS),
        "answers": message_rows(messages.ANSWERS),
        "events": message_rows(messages.EVENTS),
        "settings": setting_rows(),
        "command fields": field_rows(messages.COMMANDS),
        "answer fields": field_rows(messages.ANSWERS[:-1]),
        "event fields": field_rows(messages.EVENTS),
        "status": status_rows(),
        "damage": damage_rows(),
        "times": time_rows(),
        "usb": usb_rows(),
        "session": session_rows(),
        "counters": ", ".join(f"`{c}`" for c in messages.COUNTERS),
        "schema": f"`0x{schema():08X}`",
    }


def page() -> str:
    """docs/protocol.md as it should be."""
    text = PAGE.read_text()
    for name, table in page_tables().items():
        text, n = re.subn(
            rf"(<!-- {name} -->\n\n).*?(\n\n<!-- / -->)", lambda m, t=table: m[1] + t + m[2], text, flags=re.S
        )
        assert n == 1, f"docs/protocol.md has no place for {name}"
    return text


def _value(field: str, draw: random.Random):
    if field.endswith("s"):
        return draw.randbytes(int(field[:-1]))
    bits = 8 * struct.calcsize(field)
    top = min(bits, 30)
    return draw.randrange(1 << top) if field.isupper() else draw.randrange(-(1 << top - 1), 1 << top - 1)


def vectors() -> dict[str, list[dict]]:
    """Three of every message, by file name: fields, body and wire bytes."""
    draw = random.Random(1)
    files: dict[str, list[dict]] = {}
    for group, definitions in (
        ("commands", messages.COMMANDS),
        ("answers", messages.ANSWERS),
        ("events", messages.EVENTS),
    ):
        out = files[group] = []
        for kind, name, fields, names, tail in definitions:
            for trial in range(3):
                values = tuple(_value(f, draw) for f in fields_of(fields))
                extra: bytes | list[int] = b""
                if name == "frame":
                    extra = draw.randbytes(geometry.FRAME_BYTES)
                elif tail == "B":
                    extra = draw.randbytes(
                        (0, 48, 200)[trial] if kind != messages.TYPE["flash_data"] else 16 * trial
                    )
                elif tail == "i":
                    extra = [_value("i", draw) for _ in range((1, 20, 57)[trial])]
                number = draw.randrange(1 << 16)
                code = -4 if trial == 2 and kind & messages.ANSWER else 0
                body = bytearray(700)
                length = messages.pack(body, kind, number, code, values, extra)
                body = body[:length]
                target = bytearray(wire.wire_size(length))
                end = wire.seal(bytearray(body + bytes(4)), length, target, 0)
                out.append(
                    {
                        "name": name,
                        "type": kind,
                        "id": number if messages.head_size(kind) > 1 else None,
                        "status": code if kind & messages.ANSWER else None,
                        "fields": {
                            n: v.hex() if isinstance(v, bytes) else v
                            for n, v in zip(names.split(), values, strict=True)
                        }
                        if code == 0
                        else {},
                        "tail": extra.hex() if isinstance(extra, bytes) else extra,
                        "body": body.hex(),
                        "wire": target[:end].hex(),
                    }
                )
    return files


def vector_text(rows: list[dict]) -> str:
    return "[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n"


def main() -> None:
    text = TABLES.read_text()
    TABLES.write_text(re.sub(r"^SCHEMA = .*$", f"SCHEMA = 0x{schema():08X}", text, flags=re.M))
    PAGE.write_text(page())
    HEADER.write_text(c_header.header())
    VECTORS.mkdir(parents=True, exist_ok=True)
    for name, rows in vectors().items():
        (VECTORS / f"{name}.json").write_text(vector_text(rows))
    (VECTORS / "meaning.json").write_text(vector_text(protocol_session.meanings()))


if __name__ == "__main__":
    main()
