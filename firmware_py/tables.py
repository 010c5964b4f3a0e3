"""The wire's tables: messages, settings and counters, each defined once. docs/protocol.md shows them.

`python -m tests.firmware_py.protocol_files` writes what is derived from them.
"""

PROTOCOL = 2  # raised when an older end would misread something; docs/protocol.md, Versions
FIRMWARE = b"\x00\x02\x00"  # major, minor, patch

# type, name, fields (struct format, little-endian), their names, tail ("", "B" bytes, "i" 32-bit ints)
COMMANDS = (
    (0x01, "identify", "I", "nonce", ""),
    (0x02, "get_setting", "B", "key", ""),
    (0x03, "set_setting", "Bi", "key value", ""),
    (0x04, "calibrate", "BBi", "kind frames pressure_pa", ""),
    (0x05, "stream_start", "BBHI", "content every strokes lease_ms", ""),
    (0x06, "stream_stop", "", "", ""),
    (0x07, "statistics", "", "", ""),
    (0x08, "time_sync", "", "", ""),
    (0x09, "stroke_ack", "IIB", "stream stroke have", ""),
    (0x0A, "flash_begin", "I8s", "size name", ""),
    (0x0B, "flash_data", "I", "offset", "B"),
    (0x0C, "flash_verify", "8s", "name", ""),
    (0x0D, "flash_confirm", "8s", "model_id", ""),
    (0x0E, "flash_abort", "", "", ""),
    (0x0F, "read_back", "BI", "what offset", ""),
    (0x10, "stream_renew", "I", "stream", ""),
    (0x11, "results", "I", "stream", ""),
    (0x12, "reference", "B", "kind", ""),
)

ANSWERS = (
    (
        0x81,
        "identify",
        "IBI3s8sBBHBHBb8sIIBI",
        "nonce protocol schema firmware serial rows columns pitch_um bits capabilities features_version "
        "model_status model_id boots time_us damage stream",
        "",
    ),
    (0x82, "get_setting", "Biii", "key value low high", ""),
    (0x83, "set_setting", "Bi", "key value", ""),
    (0x84, "calibrate", "BBHi", "kind frames dead_cells noise_millicounts", ""),
    (0x85, "stream_start", "IIIII", "stream next_seq next_stroke time_us lease_ms", ""),
    (0x86, "stream_stop", "IIII", "stream next_seq next_stroke time_us", ""),
    (0x87, "statistics", "", "", "i"),
    (0x88, "time_sync", "II", "received_us sent_us", ""),
    (0x89, "stroke_ack", "IIB", "stream stroke missing", ""),
    (0x8A, "flash_begin", "I", "received", ""),
    (0x8B, "flash_data", "I", "received", ""),
    (0x8C, "flash_verify", "8s", "model_id", ""),
    (0x8D, "flash_confirm", "8s", "model_id", ""),
    (0x8E, "flash_abort", "8s", "model_id", ""),
    (0x8F, "read_back", "BII", "what offset size", "B"),
    (0x90, "stream_renew", "IIIII", "stream next_seq next_stroke time_us lease_ms", ""),
    (0x91, "results", "H", "waiting", "i"),
    (0x92, "reference", "BBiii", "kind held ln_fat_q24 ln_t_q24 ln_layers_q24", ""),
    (
        0xFF,
        "unknown",
        "",
        "",
        "",
    ),  # answers a type that the probe does not know, or a body too short for an id
)

# What a frame tells besides: whole numbers below 2^30, each from a method of that name on the board.
FRAME_MORE = ()  # type: tuple[str, ...]

EVENTS = (
    (
        0x40,
        "frame",
        "IIii" + "i" * len(FRAME_MORE),
        " ".join(("seq time_us position_um displacement_um",) + FRAME_MORE),
        "B",
    ),
    (0x42, "stroke_state", "HIIBIIi", "event_seq stream stroke state time_us frame_seq value", ""),
    (
        0x43,
        "map",
        "IIbBBBbiIiiii",
        "stream stroke status first_column end_column points first_mm place_um count_mpa "
        "base_q11 amplitude_q11 centre_q16 stdev_q16",
        "i",
    ),
    (
        0x44,
        "estimate",
        "IIbBBHH8sHIIII",
        "stream stroke status flags damage level_permille distance_permille model_id frames first_seq "
        "last_seq overrun time_us",
        "i",
    ),
    (0x45, "log", "BI", "level time_us", "B"),
    (0x46, "boot", "Ib", "boots status", ""),
    (0x47, "features", "IIbB", "stream stroke status version", "i"),
    (0x48, "stream_end", "IBIII", "stream reason next_seq next_stroke time_us", ""),
)

# type of an answer or event -> bytes of its fields that the first release of this protocol did not have yet:
# where an older end leaves them out they count as zero
ADDED = {}  # type: dict[int, int]

# key, name, unit, lowest, highest, default
SETTINGS = (
    (0, "frame_rate", "mHz", 100, 10000000, 50000),
    (1, "contact_threshold", "Pa", 10, 20000, 300),
    (2, "force_low", "mN/m", 0, 1000000, 15000),
    (3, "force_high", "mN/m", 1000, 10000000, 150000),
    (4, "speed_limit", "um/s", 1000, 1000000, 100000),
    (5, "stroke_start", "um", 0, 50000, 500),  # travel since contact that makes a stroke
    (6, "stroke_pause", "ms", 50, 60000, 1000),  # standing still for so long ends it
    (7, "resend_results", "ms", 50, 60000, 500),
)

# pairs of keys: the first setting stays below the second
ORDERED = ((2, 3),)

# the 32-bit counters of a statistics answer, in order; the host keeps its own beside them
COUNTERS = (
    "uptime_ms",
    "frames_acquired",
    "frames_sent",
    "frames_dropped",  # whole frames, oldest first, that the link could not carry
    "frames_overrun",  # acquisitions that came late for the rate asked
    "messages_sent",  # everything but frames
    "results_resent",  # maps, features and estimates sent again for want of an acknowledgement
    "commands",  # accepted and executed
    "commands_duplicate",  # answered again from memory
    "commands_refused",  # answered with an error status
    "packets_bad_crc",
    "packets_bad_frame",
    "packets_oversize",
    "bytes_received",
    "bytes_sent",
    "strokes",  # ended, not broken off
    "estimates",  # made; each is acknowledged, given up or waiting
    "free_bytes",
    "events_dropped",  # stroke states and logs that found no room; event_seq shows the gap
    "estimates_acknowledged",
    "estimates_given_up",  # not acknowledged before their memory was needed
    "estimates_waiting",  # now
    "maps_given_up",  # maps and features, likewise
    "leases_expired",  # streams that ended because nobody renewed them
)


def schema_text():
    """The tables above as one string: what the schema hash is taken of."""
    lines = ["palpate %d" % PROTOCOL]
    for kind, name, fields, names, tail in COMMANDS + ANSWERS + EVENTS:
        lines.append(f"{kind:02x} {name} {fields} {names} {tail}")
    for key, name, unit, low, high, default in SETTINGS:
        lines.append("%d %s %s %d %d %d" % (key, name, unit, low, high, default))
    for low, high in ORDERED:
        lines.append("%d < %d" % (low, high))
    lines.append(" ".join(COUNTERS))
    return "\n".join(lines)


# CRC-32 of schema_text(), kept as a number: not every probe can compute it; a test holds it true.
SCHEMA = 0x28494A09
