"""LMS signatures, the verifying half: nothing but SHA-256, every height and width.

RFC 8554's parameter sets (32-byte nodes) and those of RFC 9858 and NIST SP 800-208 that cut SHA-256
to 24 bytes. The public key is the RFC's: type, one-time type, identifier, root; 56 or 48 bytes. What is
signed is read in pieces, so an image never has to fit into memory.
"""

from firmware_py import status

try:
    import hashlib

    sha256 = getattr(hashlib, "sha256", None)
except ImportError:  # a board without SHA-256: a build that cannot take models over the wire
    sha256 = None

PIECE = 256


def available():
    """True where this firmware can verify a signature at all."""
    return sha256 is not None


def parameters(key):
    """(node size, height, bits a digit, digits, checksum's shift) of a key; None for types we do not know."""
    if len(key) < 24 or key[:3] != b"\0\0\0" or key[4:7] != b"\0\0\0":
        return None
    if 5 <= key[3] <= 9 and 1 <= key[7] <= 4:
        size = 32
        height = key[3] - 4
        width, digits, shift = ((1, 265, 7), (2, 133, 6), (4, 67, 4), (8, 34, 0))[key[7] - 1]
    elif 10 <= key[3] <= 14 and 5 <= key[7] <= 8:
        size = 24
        height = key[3] - 9
        width, digits, shift = ((1, 200, 8), (2, 101, 6), (4, 51, 4), (8, 26, 0))[key[7] - 5]
    else:
        return None
    if len(key) != 24 + size:
        return None
    return size, 5 * height, width, digits, shift


def signature_size(key):
    """Bytes of any signature under this key, or 0 for a key we do not know."""
    p = parameters(key)
    return 12 + p[0] * (1 + p[3] + p[1]) if p else 0


def _u32(b):
    return b[0] << 24 | b[1] << 16 | b[2] << 8 | b[3]


def digits_of(q, width, n, shift):
    """The n digits of a hash and its checksum (RFC 8554, 4.4)."""
    most = (1 << width) - 1
    in_hash = 8 * len(q) // width
    digits = bytearray(n)
    total = 0
    for i in range(in_hash):
        at = i * width
        v = q[at >> 3] >> (8 - width - (at & 7)) & most
        digits[i] = v
        total += most - v
    total <<= shift
    for i in range(in_hash, n):
        digits[i] = total >> (16 - width * (i - in_hash + 1)) & most
    return digits


def verify(key, read, size):
    """Does the end of what `read(offset, n)` gives (size bytes in all) sign what stands before it?

    Returns OK, BAD_SIGNATURE, or NOT_SUPPORTED where the board has no SHA-256.
    """
    if sha256 is None:
        return status.NOT_SUPPORTED
    p = parameters(key)
    if p is None:
        return status.BAD_SIGNATURE
    cut, height, width, n_digits, shift = p
    body = size - signature_size(key)
    if body <= 0:
        return status.BAD_SIGNATURE
    ident = key[8:24]
    head = read(body, 8 + cut)
    if len(head) != 8 + cut or head[4:8] != key[4:8]:
        return status.BAD_SIGNATURE
    leaf = head[:4]
    if head[0] or _u32(head) >> height:
        return status.BAD_SIGNATURE
    # the message's hash, piece by piece
    h = sha256(ident + leaf + b"\x81\x81" + head[8:])
    at = 0
    while at < body:
        piece = read(at, min(PIECE, body - at))
        if not piece:
            return status.BAD_SIGNATURE
        h.update(piece)
        at += len(piece)
    digits = digits_of(h.digest()[:cut], width, n_digits, shift)
    # each digit's chain to its end
    most = (1 << width) - 1
    link = bytearray(23 + cut)  # identifier, leaf, digit number (2), step, node
    link[:20] = ident + leaf
    ends = sha256(ident + leaf + b"\x80\x80")
    at = body + 8 + cut
    for i in range(n_digits):
        node = read(at, cut)
        at += cut
        link[20] = i >> 8
        link[21] = i & 255
        for step in range(digits[i], most):
            link[22] = step
            link[23:] = node
            node = sha256(link).digest()[:cut]
        ends.update(node)
    # and the path from the leaf to the root
    if read(at, 4) != key[:4]:
        return status.BAD_SIGNATURE
    at += 4
    number = (1 << height) + _u32(leaf)
    node = ends.digest()[:cut]
    node = sha256(ident + number.to_bytes(4, "big") + b"\x82\x82" + node).digest()[:cut]
    while number > 1:
        other = read(at, cut)
        at += cut
        pair = other + node if number & 1 else node + other
        number >>= 1
        node = sha256(ident + number.to_bytes(4, "big") + b"\x83\x83" + pair).digest()[:cut]
    return status.OK if node == key[24:] else status.BAD_SIGNATURE
