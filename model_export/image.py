"""Building and reading model images on the host; the layout is `firmware_py.image`'s."""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass

from firmware_py import evaluator, lms, status
from firmware_py import features as firmware_features
from firmware_py import image as fw
from model_export import compiler
from model_export.errors import ImageError, ModelError
from model_export.schema import KINDS, OUTPUTS, ModelSpec

MAX_COUNTER = (1 << 30) - 1


def self_test_ids(spec: ModelSpec) -> list[int]:
    """Features a self-test vector holds: the model's, then those only the lump rule looks at."""
    names = list(spec.features)
    names += [limit.feature for limit in spec.lump if limit.feature not in names]
    return compiler.feature_ids(list(dict.fromkeys(names)))


def _self_test(spec: ModelSpec, tables: evaluator.Tables, vectors: list[list[int]]) -> bytes:
    from array import array

    ids = self_test_ids(spec)
    raw = bytes((len(vectors), len(ids), *ids))
    raw += bytes(-len(raw) % 4)
    for vector in vectors:
        x = array("i", [0] * firmware_features.COUNT)
        for ident, value in zip(ids, vector, strict=True):
            x[ident] = value
        out = array("i", [0] * evaluator.OUT_SIZE)
        tables.evaluate(x, out)
        raw += struct.pack(f"<{len(ids) + fw.TESTED}i", *vector, *out[: fw.TESTED])
    return raw


def build(
    spec: ModelSpec,
    tables: evaluator.Tables,
    force_map: bytes | None,
    vectors: list[list[int]],
    counter: int,
    replaces: int = 0,
) -> bytes:
    """The image without its signature.

    Parameters
    ----------
    spec, tables : the model and its tables (`compiler.compile_model`)
    force_map : bytes or None
        Blob of `firmware_py.forcemap`.
    vectors : list of list of int
        Self-test inputs, Q24, in the order of `self_test_ids`.
    counter : int
        Security counter; a probe that has confirmed a higher one refuses the image.
    replaces : int
        For a rollback: the highest counter that this image may replace; 0 for an ordinary image.
    """
    if not 0 <= counter <= MAX_COUNTER or not 0 <= replaces <= MAX_COUNTER:
        raise ModelError(f"a security counter lies between 0 and {MAX_COUNTER}")
    if replaces and replaces < counter:
        raise ModelError("a rollback replaces newer images: its limit must not be below its own counter")
    info = "\n".join((",".join(spec.features), ",".join(name for name, _ in OUTPUTS), "1e-6"))
    sections = {
        fw.NUMBERS: tables.head.tobytes(),
        fw.IDS: bytes(tables.ids),
        fw.FEATURES: tables.feats.tobytes(),
        fw.STEPS: bytes(tables.steps),
        fw.HIGH: tables.c.tobytes(),
        fw.LOW: tables.d.tobytes(),
        fw.ROWS: tables.rows.tobytes(),
        fw.OUTPUTS: tables.outs.tobytes(),
        fw.LIMITS: tables.limits.tobytes(),
        fw.INFO: info.encode("ascii"),
        fw.FORCE_MAP: force_map or b"",
        fw.SELF_TEST: _self_test(spec, tables, vectors),
    }
    table, content = b"", b""
    for tag, raw in sections.items():
        if raw:
            if len(raw) > 0xFFFF:
                raise ModelError(f"section {tag} of the image would have {len(raw)} bytes; 65535 fit")
            table += struct.pack("<BBH", tag, 0, len(raw))
            content += raw + bytes(-len(raw) % 4)
    size = fw.HEAD_SIZE + len(table) + len(content)

    def head(model_id: bytes) -> bytes:
        return struct.pack(
            "<4sBBBBIIIB3x16s8s32s", fw.MAGIC, fw.VERSION, KINDS.index(spec.kind), spec.features_version,
            fw.ROLLBACK if replaces else 0, size, counter, replaces, len(table) // 4,
            spec.probe.encode("ascii"), model_id, bytes.fromhex(spec.training["hash"]),
        )  # fmt: skip

    # the id is the hash of everything else in the image
    model_id = hashlib.sha256(head(bytes(8)) + table + content).digest()[:8]
    return head(model_id) + table + content


@dataclass(frozen=True)
class Info:
    """What an image says of itself.

    Attributes
    ----------
    kind, probe, model_id (hex), training (hex), features, features_version
    counter, replaces : int
        Security counter, and for a rollback the highest counter it may replace.
    size : int
        Bytes with the signature.
    signature : str or None
        None if no key was given, else "good".
    model : firmware_py.image.Model
    """

    kind: str
    probe: str
    model_id: str
    training: str
    features: tuple[str, ...]
    features_version: int
    counter: int
    replaces: int
    size: int
    signature: str | None
    model: fw.Model


def _body_size(data: bytes, key: bytes | None) -> int:
    if key is not None:
        code = lms.verify(key, lambda at, n: data[at : at + n], len(data))
        if code != status.OK:
            raise ImageError(
                "the image's signature does not fit the key: it was changed, or another key signed it"
            )
        return len(data) - lms.signature_size(key)
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
        if header.features_version != firmware_features.FEATURES_VERSION:
            raise ImageError(
                f"the model needs version {header.features_version} of the features, "
                f"this firmware computes version {firmware_features.FEATURES_VERSION}"
            )
        unknown = [name for name in names if name not in firmware_features.NAMES]
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
        len(data),
        None if key is None else "good",
        model,
    )
