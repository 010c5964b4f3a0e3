"""A model as source code: straight-line Python, `.py` and `.mpy`."""
