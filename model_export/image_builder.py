"""Building and reading model images on the host; the layout is `firmware_py.model_image`'s."""

from __future__ import annotations

import hashlib
import struct
from array import array
from dataclasses import dataclass

from firmware_py import evaluator, feature_names, model_check, signature, stage, status, unpack
from firmware_py import features as firmware_features
from firmware_py import model_image as fw
from palpate.fixedpoint import nested
from palpate.model_export import self_test
from palpate.model_export.errors import ImageError, ModelError, ProofError
from palpate.model_export.integers import compiler
from palpate.model_export.schema import KINDS, OUTPUTS, ModelSpec

MAX_COUNTER = fw.MAX_COUNTER
_NUMBERS = (  # of the model's head, in the order of `unpack.head`
    evaluator.HARD_BELOW,
    evaluator.FORCE_LO,
    evaluator.FORCE_HI,
    evaluator.DOWNS,
    evaluator.LEVEL_PERMILLE,
    evaluator.MARGIN,
    evaluator.N_FEATURES,
    evaluator.LOW_BITS,
    evaluator.LINKS,
    evaluator.PART_BITS,
    evaluator.HIGH_BITS,
)


def packed(words: list[int], sizes: list[int]) -> bytes:
    """Signed numbers of sizes[0], sizes[1], .. bits in turns, lowest bit first."""
    whole = at = 0
    for k, word in enumerate(words):
        bits = sizes[k % len(sizes)]
        if not -1 << bits - 1 <= word < 1 << bits - 1:
            raise ProofError(f"a coefficient does not fit {bits} bits")
        whole |= (word & (1 << bits) - 1) << at
        at += bits
    return whole.to_bytes((at + 7) // 8, "little")


def in_order(tables: evaluator.Tables | stage.Stage, leaves: list[int]) -> list[int]:
    """The outputs' coefficients, of leaves and branches, in the program's order."""
    head = tables.head
    ups = [
        head[evaluator.PART_BITS] - head[evaluator.LOW_BITS] - (head[evaluator.DOWNS] >> 4 * j & 15)
        for j in range(head[evaluator.SUMS])
    ]
    words, own = iter(leaves), iter(tables.own)
    out = []
    for step in nested.from_bytes(tables.steps[: head[evaluator.STEPS]]):
        if isinstance(step, nested.Run):
            out += [next(words) for _ in range(len(ups) * len(step.terms))]
        else:
            out += [next(own) >> up for up in ups]
    return out


def _ids(ids: bytes) -> bytes:
    """Places of features as the image names them."""
    count = firmware_features.COUNT
    return bytes(i if i < count else i - count + model_check.FIRST_ID for i in ids)


def _stage(first: stage.Stage | None) -> bytes:
    """The section of a first stage, or of checks; `firmware_py.stage_image` reads it."""
    if first is None:
        return b""
    head, n = first.head, len(first.ids)
    low = head[evaluator.LOW_BITS]
    words = _with_nothing(in_order(first, [(c << low) + d for c, d in zip(first.c, first.d)]), first.count)
    sizes = _bits(words)
    feats = [first.feats[evaluator.FEATURE_ROW * i + k] for i in range(n) for k in unpack.FEATURE_KEPT]
    rows = first.rows.tolist()
    nothing = 13 - low + head[evaluator.PART_BITS] - 24  # the shift of a sum of nothing
    rows += [0, nothing] * (evaluator.OUTPUTS - first.count)
    parts = (
        struct.pack(
            f"<5B{evaluator.OUTPUTS}BBH2xI", n, first.count, low, head[evaluator.PART_BITS],
            head[evaluator.HIGH_BITS], *sizes, first.of_press, len(first.steps), head[evaluator.DOWNS],
        ),
        _ids(first.ids),
        struct.pack(f"<{len(feats)}i", *feats),
        first.ends.tobytes(),
        struct.pack(f"<{len(rows) // 2}i{len(rows) // 2}b", *rows[::2], *rows[1::2]),
        bytes(first.steps),
        packed(words, sizes),
        *self_test.of_first_stage(first),
        array("i", first.refers).tobytes(),
    )  # fmt: skip
    return b"".join(map(self_test.padded, parts))


def _with_nothing(words: list[int], count: int) -> list[int]:
    """A stage's words with zeros for the sums that it does not need: an image has as many as outputs."""
    none = [0] * (evaluator.OUTPUTS - count)
    return [w for at in range(0, len(words), count) for w in (*words[at : at + count], *none)]


def _bits(words: list[int]) -> list[int]:
    """How many bits each output's words take, the least two."""
    n = evaluator.OUTPUTS
    return [max(2, max((w ^ (w >> 31)).bit_length() for w in words[j::n]) + 1) for j in range(n)]


def _sections(spec: ModelSpec, tables: evaluator.Tables, force_map: bytes | None) -> dict[int, bytes]:
    n, outputs = tables.head[evaluator.N_FEATURES], evaluator.OUTPUTS
    low = tables.head[evaluator.LOW_BITS]
    words = [(c << low) + d for c, d in zip(tables.c, tables.d)]
    coarse = tables.c[len(words) :].tolist()
    first = outputs * tables.head[evaluator.LEAVES]
    parts = (in_order(tables, words[:first]), words[first:])
    sizes = [_bits(part) for part in parts]
    info = ",".join(spec.features) + "\n1e-6 " + ",".join(unit for _, unit in OUTPUTS)
    if (adapted := spec.training.get("adapted")) is not None:
        info += f"\nadapted from {adapted['from'][:16]} with {adapted['lumps']} lumps"
    feats = [tables.feats[evaluator.FEATURE_ROW * i + k] for i in range(n) for k in unpack.FEATURE_KEPT]
    outs = [tables.outs[evaluator.OUTPUT_ROW * j + k] for j in range(outputs) for k in unpack.OUTPUT_KEPT]
    rows = tables.rows.tolist()
    links = [tables.outs[evaluator.OUTPUT_ROW * j + evaluator.LINK] for j in range(outputs)]
    numbers = struct.pack(f"<4i2H5B{2 * outputs}B", *(tables.head[k] for k in _NUMBERS), *sizes[0], *sizes[1])
    return {
        fw.NUMBERS: numbers + (bytes(links) if max(links) > 1 else b""),
        fw.IDS: _ids(tables.ids),
        fw.FEATURES: struct.pack(f"<{len(feats)}i", *feats),
        fw.STEPS: bytes(tables.steps),
        fw.WORDS: packed(parts[0], sizes[0])
        + packed(parts[1], sizes[1])
        + packed(coarse, [fw.DISTANCE_BITS]),
        fw.ROWS: struct.pack(f"<{len(rows) // 2}i{len(rows) // 2}b", *rows[::2], *rows[1::2]),
        fw.OUTPUTS: struct.pack(f"<{len(outs)}i", *outs),
        fw.LIMITS: tables.limits.tobytes(),
        fw.INFO: info.encode("ascii"),
        fw.FORCE_MAP: force_map or b"",
        fw.SELF_TEST: self_test.section(tables, *self_test.vectors(spec, tables)),
        fw.FIRST_STAGE: b"" if spec.first is None else _stage(compiler.compile_first(spec.first)),
        fw.CHECKS: _stage(compiler.compile_checks(spec)),
    }


def build(
    spec: ModelSpec,
    tables: evaluator.Tables,
    force_map: bytes | None,
    counter: int,
    replaces: int = 0,
    info: bytes | None = None,
) -> bytes:
    """The image without its signature.

    Parameters
    ----------
    spec, tables : the model and its tables (`compiler.compile_model`)
    force_map : bytes or None
        Blob of `firmware_py.forcemap`.
    counter : int
        Security counter; a probe that has confirmed a higher one refuses the image.
    replaces : int
        For a rollback: the highest counter that this image may replace; 0 for an ordinary image.
    info : bytes, optional
        The image's text, where features and outputs are not the probe's: names, then a line that begins
        with "device".
    """
    if not 0 <= counter <= MAX_COUNTER or not 0 <= replaces <= MAX_COUNTER:
        raise ModelError(f"a security counter lies between 0 and {MAX_COUNTER}")
    if replaces and replaces < counter:
        raise ModelError("a rollback replaces newer images: its limit must not be below its own counter")
    sections = _sections(spec, tables, force_map)
    if info is not None:
        sections[fw.INFO] = info
    content = b"".join(self_test.padded(sections[tag]) for tag in (*range(1, fw.LAST + 1), fw.CHECKS))
    lengths = [len(sections[tag]) for tag in range(1, fw.LAST + 1)]
    longest = max(*lengths, len(sections[fw.CHECKS]))
    if longest > 0xFFFF:
        raise ModelError(f"a section of the image would have {longest} bytes; 65535 fit")

    def head(model_id: bytes) -> bytes:
        return struct.pack(
            f"<4sBBBBIIII16s8s32s{fw.LAST}H", fw.MAGIC, fw.VERSION, KINDS.index(spec.kind),
            spec.features_version, fw.ROLLBACK if replaces else 0, fw.HEAD_SIZE + len(content), counter,
            replaces, len(sections[fw.CHECKS]), spec.probe.encode("ascii"), model_id,
            bytes.fromhex(spec.training["hash"]), *lengths,
        )  # fmt: skip

    # the id is the hash of everything else in the image
    model_id = hashlib.sha256(head(bytes(8)) + content).digest()[:8]
    return head(model_id) + content


@dataclass(frozen=True)
class Info:
    """What an image states about itself.

    Attributes
    ----------
    kind, probe, model_id (hex), training (hex), features, features_version
    counter, replaces : int
        Security counter, and for a rollback the highest counter it may replace.
    adapted : str
        From what the model was adapted to real strokes, and with how many lumps; "" if it was not.
    size : int
        Bytes with the signature.
    signature : str or None
        None if no key was given, else "good".
    model : firmware_py.evaluator.Model
    """

    kind: str
    probe: str
    model_id: str
    training: str
    features: tuple[str, ...]
    features_version: int
    counter: int
    replaces: int
    adapted: str
    size: int
    signature: str | None
    model: evaluator.Model


def _body_size(data: bytes, key: bytes | None) -> int:
    if key is not None:
        code = signature.verify(key, lambda at, n: data[at : at + n], len(data))
        if code != status.OK:
            raise ImageError(
                "the image's signature does not fit the key: it was changed, or another key signed it"
            )
        return len(data) - signature.size(key)
    if len(data) < fw.HEAD_SIZE or data[:4] != fw.MAGIC:
        raise ImageError("this is not a model image")
    return int(struct.unpack_from("<I", data, 8)[0])


def inspect(data: bytes, key: bytes | None = None, probe: str | None = None) -> Info:
    """Read an image on the host, verifying the signature first if a public key is given.

    Raises
    ------
    ImageError
        One sentence: not an image, changed, of an unknown version, for another probe, or in need of a
        feature that this firmware does not compute (named).
    """
    body = _body_size(data, key)
    names: tuple[str, ...] = ()
    adapted = ""

    def read(at: int, n: int) -> bytes:
        return data[at : at + n]

    own = (probe or fw.PROBE.decode()).encode("ascii")
    header = fw.Header(read, body, own)
    if header.code == status.BAD_PROBE:
        other = header.probe.rstrip(b"\0").decode("ascii", "replace")
        raise ImageError(f"the model was made for the probe {other!r}, not for {own.decode()!r}")
    if header.code == status.BAD_VERSION:
        raise ImageError(f"the image has format version {data[4]}, this program knows version {fw.VERSION}")
    if header.code == status.OK:
        text = header.section(read, fw.INFO).decode("ascii", "replace")
        names = tuple(text.split("\n")[0].split(","))
        adapted = next((line for line in text.split("\n")[2:] if line.startswith("adapted ")), "")
        if header.features_version > firmware_features.FEATURES_VERSION:
            raise ImageError(
                f"the model needs version {header.features_version} of the features, "
                f"this firmware computes version {firmware_features.FEATURES_VERSION}"
            )
        elsewhere = header.places[fw.FIRST_STAGE][1] or "\ndevice " in text
        known = names if elsewhere else feature_names.NAMES
        unknown = [name for name in names if name not in known]
        if unknown:
            raise ImageError(
                f"the model needs the feature {unknown[0]!r}, which this firmware does not compute"
            )
    code, model = fw.load(read, body, firmware_features.FEATURES_VERSION, firmware_features.COUNT, own)
    if code != status.OK or model is None:
        raise ImageError(f"the image cannot be read: {status.TEXT[code]}")
    return Info(
        KINDS[header.kind] if header.kind < len(KINDS) else f"kind {header.kind}",
        own.decode(),
        header.model_id.hex(),
        header.training.hex(),
        names,
        header.features_version,
        header.counter,
        header.replaces,
        adapted,
        len(data),
        None if key is None else "good",
        model,
    )
