"""The wire's tables as a C header, docs/examples/c/palpate.h; `protocol_files` writes it."""

import re
import struct

from firmware_py import messages, outputs, status, tables
from tests.firmware_py.protocol_words import meaning_of

TYPES = {"B": "uint8_t", "b": "int8_t", "H": "uint16_t", "I": "uint32_t", "i": "int32_t"}
BYTES = {"B": 1, "b": 1, "H": 2, "I": 4, "i": 4}

HEAD = """/* The wire of a Palpate probe, made from firmware_py/tables.py by
   python -m tests.firmware_py.protocol_files; docs/protocol.md explains it.

   palpate_get_NAME takes a body (type byte first, without CRC) apart: 1, or 0 if it is too short.
   palpate_put_NAME writes a command's body (57 bytes at most) and returns its length.
   A message's `tail` points into the body. */
#ifndef PALPATE_H
#define PALPATE_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

static inline uint32_t palpate_u32(const uint8_t *p) {
    return p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}
static inline int32_t palpate_i32(const uint8_t *p) { return (int32_t)palpate_u32(p); }
static inline uint16_t palpate_u16(const uint8_t *p) { return (uint16_t)(p[0] | p[1] << 8); }
static inline void palpate_put(uint8_t *p, uint32_t value, int n) {
    for (int i = 0; i < n; i++) p[i] = (uint8_t)(value >> 8 * i);
}
static inline uint16_t palpate_id(const uint8_t *body) { return palpate_u16(body + 1); }
static inline int8_t palpate_status(const uint8_t *body) { return (int8_t)body[3]; }
"""

STATUS_NAMES = {value: name for name, value in vars(status).items() if name.isupper() and type(value) is int}


def fields_of(fields):
    return re.findall(r"\d+s|[BbHIi]", fields)


def constants() -> list[str]:
    out = [f"#define PALPATE_PROTOCOL {tables.PROTOCOL}", f"#define PALPATE_SCHEMA 0x{tables.SCHEMA:08X}u"]
    for prefix in ("CONTENT_", "CAN_", "CALIBRATE_", "STATE_", "END_", "HAVE_", "READ_", "LOG_",
                   "DAMAGE", "LEASE_", "FLASH_PIECE", "WRAP"):  # fmt: skip
        for name, value in vars(messages).items():
            if name.startswith(prefix) and isinstance(value, int):
                out.append(f"#define PALPATE_{name} {value}")
    flags = ("LUMP", "IN_DOMAIN", "SOFT", "HARD", "FORCE_OUT", "INVALID")
    out += [f"#define PALPATE_FLAG_{name} {getattr(outputs, name)}" for name in flags]
    out.append("")
    for code in sorted(STATUS_NAMES, reverse=True):
        out.append(f"#define PALPATE_{STATUS_NAMES[code]} ({code}) /* {status.TEXT[code]} */")
    out.append("")
    for key, name, unit, low, high, default in tables.SETTINGS:
        line = f"#define PALPATE_SETTING_{name.upper()} {key}"
        out.append(f"{line} /* {unit}, {low} to {high}, usually {default} */")
    out.append("")
    out += [f"#define PALPATE_COUNTER_{name.upper()} {i}" for i, name in enumerate(tables.COUNTERS)]
    return out


def type_name(kind, name):
    word = "ANSWER_" if kind & messages.ANSWER else "" if kind & 0x40 else "COMMAND_"
    return f"PALPATE_{word}{name.upper()}"


def c_name(kind, name):
    return f"palpate_{name}_answer" if kind & messages.ANSWER else f"palpate_{name}"


def structure(definition) -> list[str]:
    kind, name, fields, names, tail = definition
    out = [f"struct {c_name(kind, name)} {{"]
    for field, word in zip(fields_of(fields), names.split(), strict=True):
        unit, meaning = meaning_of(f"{name}.{word}")
        note = f"{unit}: {meaning}" if unit else meaning
        if field.endswith("s"):
            out.append(f"    uint8_t {word}[{field[:-1]}]; /* {note} */")
        else:
            out.append(f"    {TYPES[field]} {word}; /* {note} */")
    if tail:
        unit, meaning = meaning_of(f"{name}.tail")
        what = "bytes" if tail == "B" else "32-bit numbers, for palpate_i32(tail + 4 * k)"
        out.append(f"    const uint8_t *tail; /* {f'{unit}: ' if unit else ''}{meaning} */")
        out.append(f"    size_t tail_n; /* {what} */")
    return [*out, "};"]


def getter(definition) -> list[str]:
    kind, name, fields, names, tail = definition
    at, size = messages.head_size(kind), struct.calcsize("<" + fields)
    who = c_name(kind, name)
    signature = f"palpate_get_{who.removeprefix('palpate_')}(const uint8_t *body, size_t n, struct {who} *m)"
    out = [
        f"static inline int {signature} {{",
        f"    if (n < {at + size} || body[0] != 0x{kind:02X}) return 0;",
    ]
    for field, word in zip(fields_of(fields), names.split(), strict=True):
        if field.endswith("s"):
            out.append(f"    memcpy(m->{word}, body + {at}, {field[:-1]});")
            at += int(field[:-1])
            continue
        n = BYTES[field]
        read = f"body[{at}]" if n == 1 else f"palpate_u{8 * n}(body + {at})"
        out.append(f"    m->{word} = ({TYPES[field]}){read};")
        at += n
    if tail:
        out.append(f"    m->tail = body + {at};")
        out.append(f"    m->tail_n = (n - {at}){' / 4' if tail == 'i' else ''};")
    return [*out, "    return 1;", "}"]


def putter(definition) -> list[str]:
    kind, name, fields, names, tail = definition
    at = messages.head_size(kind)
    who = f"palpate_{name}"
    signature = f"palpate_put_{name}(uint8_t *body, uint16_t id, const struct {who} *m)"
    out = [
        f"static inline size_t {signature} {{",
        f"    body[0] = 0x{kind:02X};",
        "    palpate_put(body + 1, id, 2);",
    ]
    for field, word in zip(fields_of(fields), names.split(), strict=True):
        if field.endswith("s"):
            out.append(f"    memcpy(body + {at}, m->{word}, {field[:-1]});")
            at += int(field[:-1])
        else:
            out.append(f"    palpate_put(body + {at}, (uint32_t)m->{word}, {BYTES[field]});")
            at += BYTES[field]
    if tail:
        out.append(f"    memcpy(body + {at}, m->tail, m->tail_n);")
        return [*out, f"    return {at} + m->tail_n;", "}"]
    return [*out, f"    return {at};", "}"]


def simple_putter(definition) -> list[str]:
    kind, name, *_ = definition
    return [
        f"static inline size_t palpate_put_{name}(uint8_t *body, uint16_t id) {{",
        f"    body[0] = 0x{kind:02X};",
        "    palpate_put(body + 1, id, 2);",
        "    return 3;",
        "}",
    ]


def header() -> str:
    """The whole file."""
    out = [HEAD, *constants(), ""]
    everything = tables.COMMANDS + tables.ANSWERS + tables.EVENTS
    out += [f"#define {type_name(kind, name)} 0x{kind:02X}" for kind, name, *_ in everything]
    for definition in everything:
        kind, _, fields, _, tail = definition
        command = kind < 0x40
        if fields or tail:
            out += ["", *structure(definition), *(putter if command else getter)(definition)]
        elif command:
            out += ["", *simple_putter(definition)]
    return "\n".join([*out, "", "#endif", ""])
