"""What an estimate is worth: is there a lump, is it in the model's domain, is it hard or soft."""

NO_LUMP = -8  # status.NO_LUMP, repeated: the core of a small board does not carry that table


def verdict(x, ids, feats, limits, head, work, out):
    """Flags from the features and from what `compute` left in `work` and `out`; returns a status."""
    out[17] = head[8]
    flags = 1
    at = 0
    for i in range(head[4]):
        v = x[limits[at]]
        if v < limits[at + 1] or v > limits[at + 2]:
            flags = 0
        at += 3
    inside = out[16] <= 1000
    at = 0
    for i in range(head[0]):
        v = x[ids[i]]
        if v < feats[at + 5] or v > feats[at + 6]:
            inside = False
        at += 7
    for j in range(5):
        if work[j] > 0:
            inside = False
    if inside:
        flags |= 2
    if flags & 1 == 0:
        for i in range(15):
            out[i] = 0
        out[15] = flags
        return NO_LUMP
    if out[14] < head[5]:
        flags |= 8
    elif out[13] >= head[5]:
        flags |= 4
    if out[0] < head[6] or out[0] > head[7]:
        flags |= 16
    out[15] = flags
    return 0
