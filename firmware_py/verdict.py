"""What an estimate is worth: is there a lump, is it in the model's domain, is it hard or soft."""

from firmware_py import constant, outputs

const = constant.const

_VALUES = const(18)  # outputs.VALUES, here and in the next ones as plain numbers: a test holds them equal
OUTPUTS = const(6)
# places in `out`, behind the value, low and high of each output
FLAGS = const(18)
DISTANCE = const(19)
LEVEL = const(20)
OUT_SIZE = const(21)
FORCE = const(0)
E_LOW = const(13)
E_HIGH = const(14)
# entries of a model's head (evaluator.py has the others) and of a feature's row
N_FEATURES = const(0)
N_LIMITS = const(4)
HARD_BELOW = const(5)  # millionths of E_inv23
FORCE_LO = const(6)  # millionths of N/m
FORCE_HI = const(7)
LEVEL_PERMILLE = const(8)
BOX_LO = const(5)
BOX_HI = const(6)
FEATURE_ROW = const(7)
EDGE = const(1000)  # permille of the distance at which the domain ends

NO_LUMP = -8  # status.NO_LUMP, repeated: the core of a small board does not carry that table


def verdict(x, ids, feats, limits, head, work, out):
    """Flags from the features and from what `compute` left in `work` and `out`; returns a status."""
    out[LEVEL] = head[LEVEL_PERMILLE]
    flags = outputs.LUMP
    at = 0
    for i in range(head[N_LIMITS]):
        v = x[limits[at]]
        if v < limits[at + 1] or v > limits[at + 2]:
            flags = 0
        at += 3
    inside = out[DISTANCE] <= EDGE
    at = 0
    for i in range(head[N_FEATURES]):
        v = x[ids[i]]
        if v < feats[at + BOX_LO] or v > feats[at + BOX_HI]:
            inside = False
        at += FEATURE_ROW
    for j in range(OUTPUTS):
        if work[j] > 0:
            inside = False
    if inside:
        flags |= outputs.IN_DOMAIN
    if flags & outputs.LUMP == 0:
        for i in range(_VALUES):
            out[i] = 0
        out[FLAGS] = flags
        return NO_LUMP
    if out[E_HIGH] < head[HARD_BELOW]:
        flags |= outputs.HARD
    elif out[E_LOW] >= head[HARD_BELOW]:
        flags |= outputs.SOFT
    if out[FORCE] < head[FORCE_LO] or out[FORCE] > head[FORCE_HI]:
        flags |= outputs.FORCE_OUT
    out[FLAGS] = flags
    return 0
