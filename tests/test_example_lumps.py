"""The lumps that README, help, tutorials and how-tos stroke are lumps that the bundled models know."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from firmware_py import outputs
from palpate import models
from palpate.firmware_twin.replay_core import Replay
from palpate.model_export.integers import force_map
from palpate.model_export.integers.reference import evaluate, inputs
from palpate.sim.probe.over_lump import strokes_over
from palpate.sim.tissue import Case

ROOT = Path(__file__).parents[1]
STROKED = re.compile(r"""(?:emulate |lump = "|\.over\(")(d\d+(?:\.\d+)?h[A-Za-z0-9._]+)""")
"""A code behind a command or a call that strokes it."""
NOT_EXAMPLES = ("tests", ".venv", ".links", "site", "build", "out")


def stroked_codes() -> list[str]:
    """Every code that a document, a docstring or a help text strokes, in order."""
    pages = [
        path
        for suffix in ("md", "py", "js", "ipynb")
        for path in ROOT.rglob(f"*.{suffix}")
        if path.relative_to(ROOT).parts[0] not in NOT_EXAMPLES
        and "node_modules" not in path.parts
        and path.name != "CHANGELOG.md"
    ]
    return sorted({code for page in pages for code in STROKED.findall(page.read_text(encoding="utf-8"))})


PLANE = [code for code in stroked_codes() if not Case.from_code(code).solid]
SOLID = [code for code in stroked_codes() if Case.from_code(code).solid]


@cache
def held(code: str, seeds: int) -> tuple[np.ndarray, float]:
    """Share of strokes whose 90 % interval holds each output's truth, (outputs), and share in the domain."""
    case = Case.from_code(code)
    spec = models.load(models.suited_to(case))
    replay = Replay(None if spec.force_map is None else force_map.blob(spec.force_map))
    streams, calibration = strokes_over(case, "typical", 1000, strokes=seeds)
    features, truth = [], []
    for stream in streams:
        assert replay.stream(stream, calibration) == 0
        features.append(replay.features())
        said = stream.truth
        own = {"F_N_per_m": said.F_N_per_m, "E_fat_kPa": case.fat_kPa * said.stiffness}
        truth.append([own.get(name, getattr(case, name, None)) for name in outputs.NAMES])
    answers = evaluate(spec, inputs(spec, np.array(features)))
    inside = (answers["low"] <= np.array(truth)) & (np.array(truth) <= answers["high"])
    return inside.mean(0), float(answers["in_domain"].mean())


def test_documents_stroke_lumps():
    assert len(PLANE) >= 2


@pytest.mark.parametrize("code", PLANE)
def test_the_intervals_of_an_example_hold(code):
    """Help's own lump was held in 2 of 20 strokes, README's depth in 4 of 20, and none was flagged."""
    shares, known = held(code, 30)
    assert shares.min() >= 0.7, dict(zip(outputs.NAMES, shares))  # 85 %, but for chance: 30 strokes
    assert known >= 0.8


@pytest.mark.long
@pytest.mark.parametrize("code", [*PLANE, *SOLID])
def test_the_intervals_of_an_example_hold_of_a_hundred_strokes(code):
    shares, known = held(code, 100)
    assert shares.min() >= 0.85, dict(zip(outputs.NAMES, shares))
    assert known >= 0.85
