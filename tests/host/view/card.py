"""What the card says of an estimate, and what it must say."""

from __future__ import annotations

import re

import pytest

from palpate.wire.events import Estimate

pytestmark = pytest.mark.browser


def numbers_of(estimate: Estimate) -> dict[str, str]:
    """What the card must say of an estimate."""
    wanted = {"d_mm": estimate.span("d_mm"), "depth_mm": estimate.depth_mm, "t_mm": estimate.span("t_mm")}
    out = {key: "{:.1f} mm {:.1f} to {:.1f}".format(*span) for key, span in wanted.items()}
    out["F_N_per_m"] = "{:.0f} N/m {:.0f} to {:.0f}".format(*estimate.span("F_N_per_m"))
    out["E_fat_kPa"] = "{:.1f} kPa {:.1f} to {:.1f}".format(*estimate.span("E_fat_kPa"))
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
