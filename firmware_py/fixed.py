"""Fixed-point arithmetic on small integers: every intermediate stays inside +-2^30.

Unless said otherwise a number is in Q24: the integer v stands for v / 2^24. The same
integers come out on CPython, on 32-bit MicroPython ports (31-bit small integers) and on a Cortex-M0.
"""

LN2 = 11629080  # ln 2
LIMIT = 0x1FFFFFFF  # 2^29 - 1: no feature or factor is larger

# ln((2 i + 65) / 64), the middle of the i-th of 32 pieces of [1, 2)
_LN = (
    260117, 768556, 1262040, 1741421, 2207485, 2660951, 3102482, 3532691,
    3952143, 4361364, 4760840, 5151025, 5532342, 5905184, 6269921, 6626896,
    6976434, 7318838, 7654394, 7983370, 8306018, 8622579, 8933277, 9238326,
    9537927, 9832271, 10121541, 10405907, 10685534, 10960577, 11231183, 11497493,
)  # fmt: skip

# exp((2 i + 1) / 64), the middle of the i-th piece, 1/32 wide, of [0, ln 2)
_EXP = (
    17041419, 17582371, 18140496, 18716337, 19310457, 19923437, 20555875, 21208388,
    21881615, 22576212, 23292858, 24032252, 24795118, 25582199, 26394266, 27232110,
    28096550, 28988430, 29908621, 30858023, 31837562, 32848194, 33890908,
)  # fmt: skip


def mul(a, b):
    """a * b / 2^24, rounded down, for |a|, |b| < 2^29 and a result inside +-2^30."""
    c = a >> 12
    a &= 4095
    d = b >> 12
    b &= 4095
    return c * d + ((c * b + a * d + (a * b >> 12)) >> 12)


def ratio(a, b):
    """a / b in Q24 for |a| < 2^30 and b > 0; held at +-LIMIT where the quotient is 32 or more."""
    while b >= 0x400000:
        a >>= 1
        b >>= 1
    if b <= 0:
        return LIMIT if a > 0 else -LIMIT
    q = a // b
    if q >= 32:
        return LIMIT
    if q < -32:
        return -LIMIT
    r = (a - q * b) << 8
    d = r // b
    q = (q << 8) + d
    r = (r - d * b) << 8
    d = r // b
    q = (q << 8) + d
    r = (r - d * b) << 8
    return (q << 8) + r // b if q > -0x200000 else -LIMIT


def ln(x):
    """Natural logarithm of an integer 1 <= x < 2^30, in Q24, within 1.5e-7; x < 1 counts as 1."""
    if x < 1:
        return 0
    e = 29
    if x < 0x8000:
        x <<= 15
        e -= 15
    if x < 0x400000:
        x <<= 8
        e -= 8
    if x < 0x4000000:
        x <<= 4
        e -= 4
    if x < 0x10000000:
        x <<= 2
        e -= 2
    if x < 0x20000000:
        x <<= 1
        e -= 1
    i = (x >> 24) & 31
    # x = middle * (1 + z), |z| < 1/64; z and its powers in Q29
    z = (((x & 0xFFFFFF) - 0x800000) << 6) // (i + i + 65)
    w = z >> 9
    q = (w * w) >> 11
    z += (((q >> 6) * w // 3) >> 14) - (q >> 1)
    return e * LN2 + _LN[i] + ((z + 16) >> 5)


def exp(v, s):
    """exp(v / 2^24) in Q(24 - s), relative error below 3e-7 plus one unit; held at 2^30 - 1."""
    n = v // LN2
    v -= n * LN2
    i = v >> 19
    v = (v & 0x7FFFF) - 0x40000
    w = v >> 4
    q = (w * w) >> 16
    v += (q >> 1) + (((q >> 4) * w // 6) >> 16)
    m = _EXP[i]
    m += mul(m, v)
    s -= n
    if s > 30:
        return 0
    if s > 0:
        return (m + (1 << (s - 1))) >> s
    if s < -4:
        return 0x3FFFFFFF
    return m << -s


def asinh(x):
    """Inverse hyperbolic sine of a Q24 number below 32, in Q24, within 1e-6."""
    a = x if x >= 0 else -x
    if a < 0x6000000:
        # below 6: ln(a + sqrt(a^2 + 1))
        y = mul(a, a) + 0x1000000
        r = ln(a + exp((ln(y) - 24 * LN2) >> 1, 0)) - 24 * LN2
    else:
        # from 6 up: ln(2 a) + 1 / (4 a^2) - 3 / (32 a^4)
        r = ratio(0x1000000, a)
        y = mul(r, r)
        r = ln(a) - 23 * LN2 + (y >> 2) - (3 * mul(y, y) >> 5)
    return r if x >= 0 else -r
