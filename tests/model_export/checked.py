"""An int that refuses to leave +-2^30, as a small int of a 32-bit MicroPython would."""

from __future__ import annotations


class Checked(int):
    """Every result of arithmetic is checked and is Checked again."""

    def __new__(cls, value: int) -> Checked:
        assert -(2**30) <= value < 2**30, f"{value} is beyond 2^30"
        return super().__new__(cls, value)


def _checked(name: str):
    plain = getattr(int, name)

    def operation(self, *others):
        result = plain(self, *others)
        return result if result is NotImplemented else Checked(result)

    return operation


for _name in ("add", "sub", "mul", "floordiv", "mod", "lshift", "rshift", "and", "or", "xor"):
    for _side in (f"__{_name}__", f"__r{_name}__"):
        setattr(Checked, _side, _checked(_side))
for _name in ("__neg__", "__abs__", "__invert__"):
    setattr(Checked, _name, _checked(_name))
