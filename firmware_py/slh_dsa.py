"""SLH-DSA signatures (FIPS 205, set SHA2-128s), the verifying half: nothing but SHA-256, and no state.

Stateless: a signing key may sign twice, in two places, from a copy, without giving itself away. A public key
is "SLH", the set's number, seed and root: 36 bytes. What is signed is read in pieces, so that an image never
has to fit into memory. Numbers stay below 2^30: the tree's address, 54 bits, is held in two halves.
"""

from firmware_py import status

try:
    import hashlib

    sha256 = hashlib.sha256
except (ImportError, AttributeError):  # a board without it: a build that cannot take models over the wire
    sha256 = None  # type: ignore[assignment,misc]

try:
    from firmware_py import sha_thumb
except (ImportError, SyntaxError, AttributeError, ValueError, NotImplementedError, MemoryError):
    sha_thumb = None  # type: ignore[assignment]

PIECE = 1024
N = 16  # bytes of a node
CHAINS = 35  # of a one-time signature: 32 digits of four bits and three of their checksum
KEY_SIZE = 4 + 2 * N

# a key's number of its set: layers of trees, their height, few-time trees (FORS), their height
SETS = {1: (7, 9, 14, 12)}  # SHA2-128s

# an address behind the seed's block: layer (1), tree (8), type (1), then three words
_LAYER = 64
_TREE = 65
_TYPE = 73
_PAIR = 74
_HEIGHT = 78  # or the chain's number
_INDEX = 82  # or the step in the chain
_NODE = 86
_ONE = _NODE + N  # bytes that become a node: behind the address one node, or two
_PAIR_OF = _NODE + 2 * N
_BLOCKS = 128  # SHA-256 works on blocks of 64
_CHAIN, _ONE_TIME, _NODES, _FEW, _ROOTS = 0, 1, 2, 3, 4


def available():
    """True where this firmware can verify a signature at all."""
    return sha256 is not None


def parameters(key):
    """The set of a public key: layers, height, FORS trees, their height; None for a key that is none."""
    if len(key) != KEY_SIZE or bytes(key[:3]) != b"SLH":
        return None
    return SETS.get(key[3])


def signature_size(key):
    """Bytes of any signature under this key, or 0 for a key we do not know."""
    p = parameters(key)
    if p is None:
        return 0
    layers, height, trees, depth = p
    return N * (1 + trees * (depth + 1) + layers * (CHAINS + height))


def verify(key, read, size, context):
    """Does the end of what `read(offset, n)` gives (size bytes in all) sign what stands before it?

    context: what it is for (signature.py).
    Returns OK, BAD_SIGNATURE, or NOT_SUPPORTED where the board has no SHA-256.
    """
    if sha256 is None:
        return status.NOT_SUPPORTED
    p = parameters(key)
    if p is None:
        return status.BAD_SIGNATURE
    layers, height, trees, depth = p
    body = size - signature_size(key)
    if body <= 0:
        return status.BAD_SIGNATURE
    digest = _digest(key, read, body, context, (trees * depth + 7) // 8, height * (layers - 1), height)
    if digest is None:
        return status.BAD_SIGNATURE
    few, high, low, leaf = digest
    link = bytearray(_BLOCKS)  # seed and zeros, address, one node; room for a digest's other half
    link[:N] = key[4 : 4 + N]
    pair = bytearray(link)
    nodes = _fast(link, pair) or _plain
    at = body + N
    _place(link, 0, high, low, leaf)
    node = _few_times(nodes, link, pair, read, at, few, trees, depth)
    at += N * trees * (depth + 1)
    for layer in range(layers):
        if node is None:
            return status.BAD_SIGNATURE
        _place(link, layer, high, low, leaf)
        node = _one_tree(nodes, link, pair, read, at, node, leaf, height)
        at += N * (CHAINS + height)
        leaf = low & (1 << height) - 1
        low = low >> height | (high & (1 << height) - 1) << 27 - height
        high >>= height
    return status.OK if node is not None and bytes(node) == bytes(key[4 + N :]) else status.BAD_SIGNATURE


def _plain(buffer, size, n):
    """n times: the node of buffer[:size] into its place behind the address, whose last byte rises by one."""
    message = memoryview(buffer)[:size]
    for _ in range(n):
        buffer[_NODE : _NODE + 2 * N] = sha256(message).digest()
        buffer[_INDEX + 3] = buffer[_INDEX + 3] + 1 & 255


def _fast(link, pair):
    """The same in machine code, once it has given the same nodes here; None where there is none."""
    if sha_thumb is None:
        return None
    try:
        made = sha_thumb.Nodes(link[: sha_thumb.BLOCK])
    except (ValueError, MemoryError):
        return None
    sha_thumb.pad(link, _ONE)
    sha_thumb.pad(pair, _PAIR_OF)
    return made.nodes


def _digest(key, read, body, context, few_bytes, tree_bits, leaf_bits):
    """What picks the places in the trees: FORS digits' bytes, tree (upper and lower 27 bits), leaf."""
    r = read(body, N)
    if len(r) != N:
        return None
    h = sha256(r + key[4:])
    h.update(bytes((0, len(context))) + context)
    at = 0
    while at < body:
        piece = read(at, min(PIECE, body - at))
        if not piece:
            return None
        h.update(piece)
        at += len(piece)
    start = r + key[4 : 4 + N] + h.digest()
    tree_bytes = (tree_bits + 7) // 8
    d = sha256(start + b"\0\0\0\0").digest()
    few = d[:few_bytes]
    high = 0
    low = 0
    for b in d[few_bytes : few_bytes + tree_bytes]:
        high = (high << 8 | low >> 19) & 0x7FFFFFF
        low = (low & 0x7FFFF) << 8 | b
    if tree_bits < 27:
        low &= (1 << tree_bits) - 1
        high = 0
    else:
        high &= (1 << tree_bits - 27) - 1
    leaf = 0
    for b in d[few_bytes + tree_bytes : few_bytes + tree_bytes + (leaf_bits + 7) // 8]:
        leaf = leaf << 8 | b
    return few, high, low, leaf & (1 << leaf_bits) - 1


def _put(b, at, value):
    """A word of an address; its first byte is never used."""
    b[at + 1] = value >> 16 & 255
    b[at + 2] = value >> 8 & 255
    b[at + 3] = value & 255


def _place(b, layer, high, low, leaf):
    """The address of a tree and of a leaf in it."""
    b[_LAYER] = layer
    b[_TREE + 1] = high >> 21
    b[_TREE + 2] = high >> 13 & 255
    b[_TREE + 3] = high >> 5 & 255
    b[_TREE + 4] = (high & 31) << 3 | low >> 24
    b[_TREE + 5] = low >> 16 & 255
    b[_TREE + 6] = low >> 8 & 255
    b[_TREE + 7] = low & 255
    _put(b, _PAIR, leaf)


def _all_of(link, kind, pieces):
    """One node from many."""
    link[_TYPE] = kind
    _put(link, _HEIGHT, 0)
    _put(link, _INDEX, 0)
    h = sha256(link[:_NODE])
    for piece in pieces:
        h.update(piece)
    return h.digest()[:N]


def _climb(nodes, pair, node, path, at, index, height):
    """From a leaf's node to the root of its tree, by the neighbours in path[at:]."""
    for level in range(height):
        _put(pair, _HEIGHT, level + 1)
        _put(pair, _INDEX, index >> level + 1)
        other = path[at : at + N]
        at += N
        if index >> level & 1:
            pair[_NODE : _NODE + N] = other
            pair[_NODE + N : _PAIR_OF] = node
        else:
            pair[_NODE : _NODE + N] = node
            pair[_NODE + N : _PAIR_OF] = other
        nodes(pair, _PAIR_OF, 1)
        node = pair[_NODE : _NODE + N]
    return node


def _few_times(nodes, link, pair, read, at, digits, trees, depth):
    """The few-time signature's public key; None where the signature ends early."""
    roots = []
    held = 0
    have = 0
    k = 0
    for tree in range(trees):
        while have < depth:
            held = (held & 0xFFFF) << 8 | digits[k]
            have += 8
            k += 1
        have -= depth
        index = (tree << depth) + (held >> have & (1 << depth) - 1)
        path = read(at, N * (depth + 1))
        if len(path) != N * (depth + 1):
            return None
        at += N * (depth + 1)
        link[_TYPE] = _FEW
        _put(link, _HEIGHT, 0)
        _put(link, _INDEX, index)
        link[_NODE : _NODE + N] = path[:N]
        pair[:_NODE] = link[:_NODE]
        nodes(link, _ONE, 1)
        roots.append(_climb(nodes, pair, link[_NODE : _NODE + N], path, N, index, depth))
    return _all_of(link, _ROOTS, roots)


def _one_tree(nodes, link, pair, read, at, node, leaf, height):
    """The root of the tree that signs `node` with its leaf; None where the signature ends early."""
    path = read(at, N * (CHAINS + height))
    if len(path) != N * (CHAINS + height):
        return None
    link[_TYPE] = _CHAIN
    ends = []
    total = 480  # 32 digits of 15, less each: the checksum
    for chain in range(CHAINS):
        if chain < 32:
            digit = node[chain >> 1] >> (0 if chain & 1 else 4) & 15
            total -= digit
        else:
            digit = total >> 4 * (34 - chain) & 15
        link[_NODE : _NODE + N] = path[N * chain : N * chain + N]
        _put(link, _HEIGHT, chain)
        link[_INDEX + 3] = digit
        nodes(link, _ONE, 15 - digit)  # nine hashes in ten are made here
        ends.append(link[_NODE : _NODE + N])
    link[_INDEX + 3] = 0
    node = _all_of(link, _ONE_TIME, ends)
    pair[:_NODE] = link[:_NODE]
    pair[_TYPE] = _NODES
    _put(pair, _PAIR, 0)
    return _climb(nodes, pair, node, path, N * CHAINS, leaf, height)
