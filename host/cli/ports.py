"""The option `--port`, and an estimate in words, for the commands that talk to a probe."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from host.link.events import Estimate

F = TypeVar("F", bound=Callable[..., Any])

UNITS = {"F_N_per_m": "N/m", "t_mm": "mm", "d_mm": "mm", "h": "", "E_inv23": ""}
WORDS = {
    "F_N_per_m": "force",
    "t_mm": "tissue thickness t",
    "d_mm": "lump diameter d",
    "h": "relative depth h",
    "E_inv23": "stiffness E^-2/3",
}
NOMINAL_SCALE = "pressures are by the nominal scale (25 kPa over 4095 counts, .5 kPa the zero)"


def port_option(function: F) -> F:
    """`--port` and `--baud`, the same words everywhere."""
    where = "auto, a serial number, a port (/dev/ttyACM0, COM5) or socket://HOST:PORT."
    function = click.option("--baud", default=921_600, show_default=True, help="Of a UART.")(function)
    return click.option("--port", default="auto", show_default=True, help=where)(function)


def estimate_lines(estimate: Estimate) -> list[str]:
    """An estimate for people: one line each, intervals beside the values, doubts in plain words."""
    head = f"stroke {estimate.stroke}, {estimate.frames} frames"
    if not estimate.lump and estimate.reason == "no lump found":
        return [f"{head}: no lump found"]
    if not estimate.valid:
        return [f"{head}: no estimate, {estimate.reason}"]
    level = f"{estimate.level_permille / 10:g} % interval"
    lines = [f"{head}, model {estimate.model_id.hex()}"]
    for name, bounded in estimate.outputs.items():
        value, low, high = bounded["value"], bounded["low"], bounded["high"]
        lines.append(f"  {WORDS[name]:20} {value:8.3f} {UNITS[name]:4} ({low:.3f} to {high:.3f}, {level})")
    found = (
        "hard or soft, this stroke does not tell which"
        if estimate.hardness == "unsure"
        else estimate.hardness
    )
    lines.append(f"  the lump is {found}" + stiffness_words(estimate))
    if not estimate.in_domain:
        lines.append("  outside what the model was trained on: do not rely on the numbers")
    lines.append("  research use, not a diagnosis")
    return lines


def stiffness_words(estimate: Estimate) -> str:
    """E from E^-2/3 with its bounds; above 10 only a lower bound means something."""
    bounded = estimate.outputs["E_inv23"]
    low = max(bounded["high"], 1e-3) ** -1.5
    high = max(bounded["low"], 1e-3) ** -1.5
    if high > 50:
        return f"; more than {low:.2g} times as stiff as the fat"
    return f"; {low:.2g} to {high:.2g} times as stiff as the fat"
