"""The sensor array of this probe: the one file that says what it is. geometry.py works out the rest.

Another array is another copy of this file (docs/howto/another-array.md).
"""

ROWS = 16  # along the stroke
COLUMNS = 26  # across it
PITCH_UM = 1500  # from cell to cell, both ways
FULL_SCALE_PA = 25000  # what a cell reads as full scale, above its pedestal
PEDESTAL_PA = 500  # what an unloaded cell reads
