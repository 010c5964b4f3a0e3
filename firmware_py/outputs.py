"""What a model estimates: the outputs in their order, with units, words and ranges; all take them from here.

The truth of each is the attribute of that name of `palpate.sim.tissue.Case`; F alone is what the hand kept.
The wire and the evaluator carry millionths of these units. Loops hold some numbers of this table as they are:
`python -m tests.firmware_py.output_numbers` writes them anew when it has changed.
"""

# Name on the wire and in JSON; unit; whether the model predicts its logarithm; words. Then the range that
# the field model is for (t follows from d and h; hard lumps look alike), and that which holds its estimates:
# wider, so that a lump beyond the first is seen to be.
TABLE = (
    # force per metre of probe width
    ("F_N_per_m", "N/m", True, "force", 29.0, 104.0, 15.0, 140.0),
    # thickness of the fat
    ("t_mm", "mm", True, "tissue thickness t", 0.0, float("inf"), 2.5, 65.0),
    # diameter of the lump
    ("d_mm", "mm", True, "lump diameter d", 5.0, 20.0, 3.5, 28.0),
    # depth of its middle less half a diameter, over the diameter
    ("h", "1", True, "relative depth h", 0.3, 1.5, 0.15, 2.4),
    # (stiffness over the fat's)^(-2/3)
    ("E_inv23", "1", False, "stiffness E^-2/3", 0.0, 2.0 ** (-2 / 3), 1000.0 ** (-2 / 3), 0.9),
    # the fat's modulus at rest; a model that was told its tissue repeats what it was told
    ("E_fat_kPa", "kPa", True, "stiffness of the fat", 2.0, 40.0, 1.4, 56.0),
)
NAMES = tuple([row[0] for row in TABLE])
UNITS = tuple([row[1] for row in TABLE])
LOGARITHMIC = tuple([row[2] for row in TABLE])
COUNT = len(TABLE)
E_INV23 = NAMES.index("E_inv23")  # decides what is hard
# what a model repeats that was told its tissue; the last, where it is there
E_FAT = NAMES.index("E_fat_kPa") if "E_fat_kPa" in NAMES else COUNT
SCALE = 1000000
PARTS = ("value", "low", "high")  # of each, one after the other
VALUES = len(PARTS) * COUNT  # integers

# flags of an estimate (bits), as the evaluator sets them and the wire carries them
LUMP = 1
IN_DOMAIN = 2
SOFT = 4  # neither soft nor hard: unsure
HARD = 8
FORCE_OUT = 16
INVALID = 32
REFERENCE = 64  # the reference press of the visit is in it
REFERENCE_OFF = 128  # there is one, and it does not fit this place: it is not in it
