"""What the card says of an estimate, and what it must say."""

from __future__ import annotations

import re

import pytest

from palpate.link.events import Estimate
from palpate.view.phrases import depth_mm
from palpate.view.translate import estimate as as_shown

pytestmark = pytest.mark.browser


def numbers_of(estimate: Estimate) -> dict[str, str]:
    """What the card must say of an estimate."""
    shown = as_shown(estimate)
    depth = depth_mm(shown.t_mm, shown.d_mm, shown.h)
    wanted = {"d_mm": shown.d_mm, "depth_mm": depth, "t_mm": shown.t_mm}
    out = {key: f"{v.value:.1f} mm {v.low:.1f} to {v.high:.1f}" for key, v in wanted.items()}
    force = shown.F_N_per_m
    out["F_N_per_m"] = f"{force.value:.0f} N/m {force.low:.0f} to {force.high:.0f}"
    fat = shown.further["E_fat_kPa"]
    out["E_fat_kPa"] = f"{fat.value:.1f} kPa {fat.low:.1f} to {fat.high:.1f}"
    return out


def numbers_on(page) -> dict[str, str]:
    """What the card says, on one line each, without labels and scales."""
    found = {}
    for node in page.locator("#card [data-key]").all():
        value = " ".join(node.locator("dd", has=page.locator(".number")).inner_text().split())
        between = re.search(r"[\d.]+ to [\d.]+", node.locator(".range-text").inner_text())
        key = node.get_attribute("data-key")
        if key != "stiffness":
            found[key] = f"{value.split(between[0])[0].strip()} {between[0]}"
    return found
