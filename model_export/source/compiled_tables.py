"""A compiled model's tables, by what stands in them: every source that is written reads them here."""

from __future__ import annotations

from firmware_py import evaluator as ev
from firmware_py.stage import Stage
from palpate.fixedpoint import nested
from palpate.fixedpoint.nested import Run
from palpate.model_export.schema import FirstStage, ModelSpec

N = ev.OUTPUTS


class CompiledTables:
    """Rows and words of the tables.

    Parameters
    ----------
    spec, tables : the model, and what `compiler.compile_model` made of it; or a stage of it
    places : dict
        Where in `features` each of the firmware's features stands, by its index there.
    """

    def __init__(
        self, spec: ModelSpec | FirstStage, tables: ev.Tables | Stage, places: dict[int, int]
    ) -> None:
        self.spec = spec
        self.t = tables
        self.places = places
        head = tables.head
        self.n, self.leaves = head[ev.N_FEATURES], head[ev.LEAVES]
        self.low, self.part, self.high = head[ev.LOW_BITS], head[ev.PART_BITS], head[ev.HIGH_BITS]
        self.low_sum_shift = self.low + self.high - self.part
        self.downs = [head[ev.DOWNS] >> 4 * j & 15 for j in range(N + 1)]
        self.steps = nested.from_bytes(tables.steps[: head[ev.STEPS]])
        self.runs = nested.from_bytes(tables.steps[head[ev.STEPS] :])
        self.branching = {step.branch[-1] for step in self.steps if not isinstance(step, Run)}
        self.named = [f"y{j}" for j in range(N)] + [str(i) for i in range(self.n)]

    def feature_row(self, i: int) -> list[int]:
        """The scaling and the domain's box of input i."""
        return list(self.t.feats[ev.FEATURE_ROW * i : ev.FEATURE_ROW * (i + 1)])

    def output_row(self, j: int) -> list[int]:
        """Link, ends, middle, shift, quantiles and range of output j."""
        assert isinstance(self.t, ev.Tables)
        return list(self.t.outs[ev.OUTPUT_ROW * j : ev.OUTPUT_ROW * (j + 1)])

    def sum_row(self, row: int) -> list[int]:
        """Intercept and shift of a sum: those of the outputs, of ln sigma, of the whitened coordinates."""
        return list(self.t.rows[ev.ROW * row : ev.ROW * (row + 1)])

    def words(self, at: int, j: int, n: int) -> tuple[list[int], list[int]]:
        """High and low words of output j's sum, of those whose words begin at `at`, over n inputs."""
        where = range(at + j, at + N * n, N)
        return [self.t.c[i] for i in where], [self.t.d[i] for i in where]
