"""The runs of the thesis, by their codes."""

THESIS_CODES: tuple[str, ...] = (
    *(f"d10h08e10f{f}" for f in ("10", "02", "04", "06", "08")),
    *(f"d10h08e{e}f10" for e in ("02", "05", "50", "1K")),
    *("d10h08e02f06", "d10h08e05f06", "d10h08e05f03", "d10h08e1Kf02", "d10h08e1Kf06", "d10h08e50f04"),
    *(f"d{d}h08e10f10" for d in ("05", "15", "20")),
    *(f"d10h{h}e10f10" for h in ("03", "05", "12", "15")),
    *("d05h15e10f10", "d20h03e10f10", "d15h05e10f10", "d20h05e10f10", "d05h12e10f10"),
    *("d15h05e05f10", "d15h03e02f10"),
    "d10h08eNLf10",
)
"""The thesis' thirty runs: 29 linear ones, the reference first, and the nonlinear one."""
