"""Freezes the firmware into a MicroPython build: `make BOARD=RPI_PICO FROZEN_MANIFEST=.../manifest.py`."""

metadata(description="Firmware of the Palpate tactile probe", version="0.1.0")  # noqa: F821
package("firmware_py", base_path="..")  # noqa: F821
