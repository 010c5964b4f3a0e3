"""Rewrite the tables and figures of docs/accuracy*.md: `python docs/fill_accuracy.py THESIS_DIR FIELD_DIR`.

Every block between `<!-- begin NAME -->` and `<!-- end NAME -->` is replaced by what the command named in
the text above it prints; the words round the blocks are written by hand. Names after the two directories
limit it to these blocks. Directories: palpate sweep --design thesis --out THESIS_DIR; FIELD_DIR may be empty.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterable
from functools import lru_cache, partial
from pathlib import Path

from rich.table import Table

from palpate.regression.any_tissue.data import ANYWHERE, prepare_strokes
from palpate.regression.any_tissue.fit import fit_in_any_tissue
from palpate.regression.anywhere.held_out import AnywhereStudy
from palpate.regression.balls.lumps import read_lumps
from palpate.regression.balls.report import tables_of
from palpate.regression.field.bench import Bench
from palpate.regression.field.data import of_the_command, prepare
from palpate.regression.field.fit import fit_field
from palpate.regression.field.result import FieldFit
from palpate.regression.field.study import STUDIES, study_table
from palpate.regression.field.tissues import TISSUE_STUDY
from palpate.regression.fit import fit
from palpate.regression.progress import ProgressCallback, ProgressLines
from palpate.regression.runs import features_table, read_strokes
from palpate.regression.thesis.fit import ThesisFit, fit_thesis
from palpate.report.study_figures import save_study_figure

DOCS = Path(__file__).parent
ANY_TISSUE_LUMPS, ANYWHERE_LUMPS = 1300, 1000
PAGES = [DOCS / f"accuracy{part}.md" for part in ("", "-told", "-thesis")]
FIGURES = DOCS / "figures"


def markdown(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown, numbers to the right."""
    names = [h.replace("\n", " ").strip() or " " for h in heads]
    rule = [":--", *("--:" for _ in names[1:])]
    lines = [names, rule, *([c.replace("|", "/") for c in row] for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def of_rich(table: Table) -> str:
    """A rich table in Markdown, with its caption below."""
    cells = [[str(c) for c in column.cells] for column in table.columns]
    text = markdown([str(column.header) for column in table.columns], zip(*cells))
    return text + (f"\n\n{table.caption}." if table.caption else "")


def _on_one_line(what: str, done: int, total: int) -> None:
    print(f"\r{what}: {done} of {total}".ljust(60), end="\n" if done == total else "", flush=True)


tell: ProgressCallback = _on_one_line if sys.stdout.isatty() else ProgressLines(partial(print, flush=True))
"""Progress: on one line of a terminal, in a file or pipe a line now and then."""


class Numbers:
    """What the blocks hold, worked out when it is asked for and once."""

    def __init__(self, thesis_dir: str, field_dir: str) -> None:
        self.thesis_dir, self.field_dir = thesis_dir, Path(field_dir)
        self.thesis = lru_cache(self._thesis)
        self.strokes = lru_cache(lambda: prepare(self.field_dir, progress=tell))
        self.field = lru_cache(self._field)
        self.anywhere = lru_cache(self._anywhere)
        self.bench = lru_cache(lambda: Bench(self.strokes(), directory=self.field_dir, progress=tell))

    def _thesis(self) -> ThesisFit:
        return fit_thesis(features_table(read_strokes(self.thesis_dir)))

    def _field(self) -> FieldFit:
        return fit_field(self.strokes(), progress=tell)

    def blocks(self) -> dict[str, Callable[[], str]]:
        """Name of a block -> what writes it."""
        equations = ("table-1", "forward", "inverse", "one-factor", "strain-force")
        thesis = {name: k for k, name in enumerate((*equations, "transforms", "permutation"))}
        names = ("held-out", "coverage", "flags", "flag-distance", "left-out", "found", "visits")
        field = {n: k for k, n in enumerate(names)}
        out: dict[str, Callable[[], str]] = {}
        for name, k in thesis.items():
            out[name] = lambda k=k: of_rich(self.thesis().tables()[k])  # type: ignore[misc]
        for name, k in field.items():
            out[name] = lambda k=k: of_rich(self.field().tables()[k])  # type: ignore[misc]
        for name in (*STUDIES, TISSUE_STUDY.name):
            out[f"study-{name}"] = lambda name=name: self._study(name)  # type: ignore[misc]
        out["which-lumps"] = self._which_lumps
        out["tissue-fit"] = self._tissue_fit
        out["any-tissue"] = self._any_tissue
        for name, those in (("", (0, 1)), ("-places", (2,)), ("-together", (3,)), ("-flags", (5, 6))):
            out[f"anywhere{name}"] = lambda those=those: "\n\n".join(  # type: ignore[misc]
                of_rich(self.anywhere()[k]) for k in those
            )
        out["balls"] = self._balls
        out["balls-study"] = self._balls_study
        return out

    def _which_lumps(self) -> str:
        if of_the_command(self.strokes()):
            return (
                "The tables below are of these lumps, seeds 21 and 23. They were scored twice: first\n"
                "without one stroke whose solver had failed, then, nothing else changed, with it; each\n"
                "time every target was met. The flag by distance was looked at afterwards, the same model's."
            )
        return "**The tables below are not of these lumps** but of other seeds."

    def _tissue_fit(self) -> str:
        strokes = prepare(self.field_dir / "soft-fat", 512, tissue={"fat_kPa": 7.0}, progress=tell)
        return of_rich(fit_field(strokes, levels=(), recipes=(), progress=tell).tables()[0])

    def _any_tissue(self) -> str:
        strokes = prepare_strokes(self.field_dir / "any", ANY_TISSUE_LUMPS, progress=tell)
        held_out, cover, flags, pairs, _ = fit_in_any_tissue(strokes, progress=tell).tables()
        return "\n\n".join(of_rich(table) for table in (held_out, flags, pairs, cover))

    def _anywhere(self) -> list[Table]:
        directory = self.field_dir / "anywhere"
        strokes = prepare_strokes(directory, ANYWHERE_LUMPS, progress=tell, design=ANYWHERE)
        return fit_in_any_tissue(strokes, progress=tell, kind=AnywhereStudy).tables()

    def _balls(self) -> str:
        held_out, cover, flags, pairs, _ = fit("tests/sim/tissue/data", "field", progress=tell).tables()
        return "\n\n".join(of_rich(table) for table in (held_out, flags, pairs, cover))

    def _balls_study(self) -> str:
        lumps = read_lumps(Path("tests/sim/tissue/data"))
        found = tables_of(lumps, "typical", 1, os.cpu_count() or 1, partial(print, flush=True))
        return "\n\n".join(f"{one.title}:\n\n{markdown(*one.text)}" for one in found)

    def _study(self, name: str) -> str:
        study = STUDIES.get(name, TISSUE_STUDY)
        result = study.table(self.bench(), tell=partial(print, flush=True))
        figure = FIGURES / f"study-{name}.svg"
        save_study_figure(study, result, figure)
        return markdown(*study_table(study, result)) + f"\n\n![{study.title}](figures/{figure.name})"


def main(thesis_dir: str, field_dir: str, *names: str) -> None:
    """Fill the blocks `names`, or all."""
    blocks = Numbers(thesis_dir, field_dir).blocks()
    for name in names or blocks:
        text = blocks[name]()
        pattern = re.compile(f"(<!-- begin {name} -->\n).*?(<!-- end {name} -->)", re.DOTALL)
        found = 0
        for path in PAGES:
            page, n = pattern.subn(
                lambda m, text=text: f"{m[1]}\n{text}\n\n{m[2]}",  # type: ignore[misc]
                path.read_text(encoding="utf-8"),
            )
            if n:
                path.write_text(page, encoding="utf-8")
            found += n
        if not found:
            sys.exit(f"no page of {', '.join(path.name for path in PAGES)} has a block {name}")
        print(f"filled {name}")


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: python docs/fill_accuracy.py THESIS_DIR FIELD_DIR [BLOCK ...]")
    main(*sys.argv[1:])
