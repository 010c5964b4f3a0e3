"""The emulated board, run by the firmware's own interpreter: CPython here, MicroPython in the WASM port.

`hostport` is the board's hardware. Under MicroPython it is a module of JavaScript functions
(../wasm/device.mjs), under CPython it is hostport.py in this folder.
"""
