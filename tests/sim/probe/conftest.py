"""A key of the host's tests for probes that can be flashed, and the firmware's strokes for the sensors."""

from tests.firmware_py.conftest import all_strokes, fields, flat_field
from tests.host.conftest import key_dir, own_directories, palpate

__all__ = ["all_strokes", "fields", "flat_field", "key_dir", "own_directories", "palpate"]
