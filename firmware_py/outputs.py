"""What a model estimates: the outputs in their order, with units and scales; everybody takes them from here.

The wire and the evaluator carry millionths of these units. `evaluator` says where they stand in its arrays.
"""

# name on the wire and in JSON, unit, whether the model predicts its logarithm
TABLE = (
    ("F_N_per_m", "N/m", True),  # force per metre of probe width
    ("t_mm", "mm", True),  # thickness of the fat
    ("d_mm", "mm", True),  # diameter of the lump
    ("h", "1", True),  # depth of its middle less half a diameter, over the diameter
    ("E_inv23", "1", False),  # (stiffness over the fat's)^(-2/3)
)
NAMES = tuple([row[0] for row in TABLE])
UNITS = tuple([row[1] for row in TABLE])
LOGARITHMIC = tuple([row[2] for row in TABLE])
COUNT = len(TABLE)
E_INV23 = NAMES.index("E_inv23")  # decides what is hard
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
