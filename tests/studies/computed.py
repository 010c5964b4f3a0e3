"""What the intervals cover on strokes that were computed, not interpolated.

Training strokes are interpolated between a few forces. Here the same lumps, probes and hands are seen through
two, three and seven forces; with seven no frame is further than 3 % from a force at which its image was
computed, and the coverage of those strokes is the one to believe.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from palpate.learn.bench import Bench
from palpate.learn.data import sweep_progress
from palpate.learn.design import FIELD_SETTINGS
from palpate.learn.lumps import FORCE_STEP, LumpStrokes, read_lumps
from palpate.learn.model import FittedModel, fit_model
from palpate.learn.observed import Observed, joined, observe
from palpate.learn.scopes import FIELD, TOLD
from palpate.learn.score import coverage
from palpate.learn.table import TARGETS
from palpate.sim.probe.sensors import StrokeField
from palpate.sim.tissue import Case, sobol_cases, sweep
from tests.studies.retrained import DRAWS, Row, Study, row_of

LUMPS = 48
_SEED, _OBSERVED = 7, (900, 901, 902)
PARTS = tuple(FORCE_STEP ** (k / 6 - 0.5) for k in range(7))


def cases() -> list[Case]:
    """The lumps at seven forces each."""
    return [replace(case, F_rel=case.F_rel * p) for case in sobol_cases(LUMPS, _SEED) for p in PARTS]


def seen_through(lumps: Sequence[LumpStrokes], every: int) -> list[StrokeField]:
    """Each lump's field through its first, last and every `every`-th force between."""
    return [StrokeField(*lump.strokes[::every]) for lump in lumps]


def covered_row(words: str, model: FittedModel, observed: Observed) -> Row:
    """Scores, and the coverage of every output's interval."""
    answers = model.answer(observed)
    table = coverage(observed, answers, answers.found)
    row = row_of(words, model, observed, answers)
    return row | {f"covered_{t}": float(table[t]["all"]) for t in TARGETS}


def _run(bench: Bench) -> Iterator[Row]:
    home = bench.directory / "computed"
    if not (home / "strokes.parquet").exists():
        report = sweep_progress("simulating at seven forces", bench.progress)
        sweep(cases(), FIELD_SETTINGS, home, workers=bench.workers, progress=report)
    lumps = [lump for lump in read_lumps(home)[0] if len(lump.strokes) == len(PARTS)]
    train, calibration, test, rim = bench.parts(bench.noise, draws=DRAWS)
    model = fit_model(TOLD.of(FIELD), train, calibration, rim)
    yield covered_row("held-out lumps, as trained", model, test)
    for words, every in (("two forces", 6), ("three forces", 3), ("computed: seven forces", 1)):
        fields = seen_through(lumps, every)
        strokes = [observe(fields, bench.noise, seed, force_map=bench.blob) for seed in _OBSERVED]
        yield covered_row(words, model, joined(strokes))


COMPUTED = Study(
    "computed", "Intervals on strokes computed at their own force", "test strokes seen through", _run
)
STUDIES = {COMPUTED.name: COMPUTED}
