"""Write what the documentation says of the bundled models: `python docs/fill_accuracy.py`.

It reads `host/models/*.json` and their recipes, whose scores `python -m palpate.models NAME DIRECTORY` wrote
beside the model. It writes a page of evidence and a model card for each, the table of README.md and of
docs/accuracy.md, and the figure. Nothing is fitted: it takes seconds. Every page carries its model's hash.

`python docs/fill_accuracy.py thesis` fits the thesis' 29 runs instead (a minute): docs/evidence/thesis.md.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from palpate.learn.study import cell
from palpate.models import ANYWHERE, BALLS, FIELD, NAMES, TOLD, load, recipe
from palpate.sim.tissue.any_tissue import TissueRanges
from palpate.wire.events import OUTPUTS

DOCS = Path(__file__).parent
ROOT = DOCS.parent
THESIS_STROKES = ROOT / "tests" / "host" / "report" / "data"
COMMAND = "python docs/fill_accuracy.py"
TABLE = re.compile(r"(<!-- begin models: .*? -->\n).*?(<!-- end models -->)", re.DOTALL)
ABSENT = "–"

Scores = dict[str, Any]
Row = Sequence[str]

TISSUE = "fat of {fat} kPa; gland {gland} times as stiff, 8 to 30 mm deep; both may stiffen"
"""The fat's range is the model's own, the gland's that of the design that it was fitted to."""
ABOUT: dict[str, dict[str, str]] = {
    BALLS: {
        "title": "Balls and ellipsoids",
        "for": "Lumps of finite length, up to 10 mm beside the stroke's line. `palpate demo` flashes it.",
        "lumps": "balls and ellipsoids, d 5 to 20 mm, h 0.3 to 1.5, E 2 to 1000",
        "tissue": TISSUE.replace("{gland}", "2 to 10"),
        "press": "needed",
        "not": "Endless cylinders. Two lumps side by side. Lumps off the border of fat and gland. "
        "Outside its ranges it seldom says so: most such lumps that it finds carry no flag.",
    },
    FIELD: {
        "title": "Cylinders on the border of fat and gland",
        "for": "Studies in plane strain, where a lump is an endless cylinder. `palpate emulate` has it.",
        "lumps": "cylinders centred on the border of fat and gland, d 5 to 20 mm, h 0.3 to 1.5, E 2 to 1000",
        "tissue": TISSUE,
        "press": "needed",
        "not": "Balls: errors are four times as large, and nearly all such strokes are flagged. "
        "Lumps off the border: use `anywhere`.",
    },
    ANYWHERE: {
        "title": "Cylinders anywhere",
        "for": "Studies in plane strain where the lump lies in the fat, across its border or in the gland.",
        "lumps": "cylinders, d 5 to 20 mm, their top 2 to 30 mm under the skin, E 2 to 1000",
        "tissue": "fat 4 to 30 mm thick and of {fat} kPa; gland {gland} times as stiff; both may stiffen",
        "press": "needed",
        "not": "Balls. Two lumps less than 16 mm apart. No depth is flagged: it has no range of its own.",
    },
    TOLD: {
        "title": "Cylinders in known tissue",
        "for": "Recordings without a press, where the tissue is known. `palpate import` takes it by default.",
        "lumps": "cylinders centred on the border of fat and gland, d 5 to 20 mm, h 0.3 to 1.5, E 2 to 1000",
        "tissue": "fat of 10 kPa, gland 6 times as stiff and 15 mm deep, neither stiffening, known to 2 %",
        "press": "used to notice another tissue, not needed",
        "not": "Any other tissue. Another gland is not noticed. The fat's modulus is assumed, not estimated.",
    },
}
"""In the order of the pages: lumps as they are, then idealised ones."""

OUTPUT_NAMES = {
    "d": "diameter", "width": "width across", "depth": "depth", "t": "fat's thickness t", "h": "h",
    "F": "force F", "E_fat": "fat's modulus", "E_inv23": "E^-2/3", "in_fat": "part in the fat",
    "place": "place across",
}  # fmt: skip


def percent(share: float | None, digits: int = 0) -> str:
    """A share as per cent."""
    return ABSENT if share is None else f"{100 * share:.{digits}f} %"


def table(heads: Row, rows: Iterable[Row]) -> str:
    """Markdown, numbers to the right."""
    rule = [":--", *("--:" for _ in heads[1:])]
    return "\n".join("| " + " | ".join(row) + " |" for row in (heads, rule, *rows))


def main_row(scores: Scores) -> Scores:
    """The held-out scores of one stroke at typical noise, with its press where the model needs one."""
    rows: list[Scores] = scores["held_out"]
    return next(row for row in rows if row["setting"] in ("typical, with its press", "typical, one stroke"))


def found(scores: Scores) -> float:
    """The share of strokes over lumps that find one."""
    return 1 - float(main_row(scores)["not_found"])


def _outputs(row: Scores) -> list[str]:
    return [key for key in row if key not in ("group", "n")]


def covered(scores: Scores) -> tuple[float, float, float]:
    """Least and greatest coverage over the outputs, of all lumps; the least in any quarter."""
    every, *parts = scores["coverage"]
    overall = [every[key] for key in _outputs(every)]
    quarters = [r[key] for r in parts if "quarter" in r["group"] for key in _outputs(r)]
    return min(overall), max(overall), min(quarters)


def held(scores: Scores) -> tuple[str, str]:
    """What `covered` gives, in words: of all lumps, and in the worst quarter."""
    low, high, worst = (f"{100 * share:.0f}" for share in covered(scores))
    return f"{low} %" if low == high else f"{low} to {high} %", f"{worst} %"


def models_table() -> str:
    """A row for each model: what README.md and docs/accuracy.md show."""
    heads = (
        "Lumps (model)",
        "Found",
        "Diameter error",
        "Depth error",
        "Hard or soft right",
        "90 % interval holds",
    )
    rows = []
    for name, about in ABOUT.items():
        scores = recipe(name)["scores"]
        row = main_row(scores)
        rows.append(
            (
                f"{about['title']} (`{name}`)", percent(found(scores)), percent(row["d_error"], 1),
                percent(row["depth_error"], 1), percent(row["hard_soft"]),
                "; worst quarter ".join(held(scores)),
            )
        )  # fmt: skip
    return table(heads, rows)


def errors_table(rows: Sequence[Scores]) -> str:
    """R2, median error and coverage of every output, by setting."""
    keys = [key for key in OUTPUT_NAMES if any(f"{key}_error" in row for row in rows)]
    heads = ("Strokes", *(OUTPUT_NAMES[key] for key in keys), "hard or soft", "not found", "lumps")
    return table(
        heads, [(row["setting"], *(cell(row, key) or ABSENT for key in keys), *_end(row)) for row in rows]
    )


def _end(row: Scores) -> tuple[str, str, str]:
    return percent(row["hard_soft"]), percent(row["not_found"]), f"{row['lumps']:.0f}"


def coverage_table(rows: Sequence[Scores]) -> str:
    """How often the intervals hold, by output and part."""
    keys = _outputs(rows[0])
    body = [
        (r["group"], *(f"{100 * r[k]:.0f}" if k in r else ABSENT for k in keys), f"{r['n']:.0f}")
        for r in rows
    ]
    return table(("Lumps", *keys, "strokes"), body)


def strange_table(rows: Sequence[Scores]) -> str:
    """Two lumps, tissue that undulates."""
    keys = ("flagged", "d_missed", "silent_before", "silent")
    heads = (
        "Strokes",
        "flagged",
        "d's interval misses",
        "misses without a flag, no checks",
        "with the checks",
        "n",
    )
    return table(heads, [(r["strokes"], *(percent(r[k]) for k in keys), f"{r['n']:.0f}") for r in rows])


def flags_table(scores: Scores) -> str:
    """What the model says of strokes that are not what it is for."""
    lines = (
        ("Lumps inside the ranges that are flagged", "flagged_inside"),
        ("Lumps outside them that are flagged, of those found", "flagged_outside"),
        ("Lumps 5 % or more outside that are flagged, of those found", "flagged_well_outside"),
        ("Lumps outside that are not found", "outside_no_lump"),
        ("Plain tissue taken for a lump", "false_alarms"),
        ("Plain tissue taken for a lump without a flag", "false_alarms_not_flagged"),
    )
    return table(
        ("Strokes", "share"), [(words, percent(scores[key], 1)) for words, key in lines if key in scores]
    )


def stamp(name: str) -> str:
    """The line that names the command and the model."""
    found = recipe(name)
    return (
        f"*Written by `{COMMAND}` from the scores that `{found['command']}` kept.*\n"
        f"*Model `{name}`, SHA-256 `{found['sha256']}`.*"
    )


def evidence(name: str) -> str:
    """The page of evidence of a model."""
    scores = recipe(name)["scores"]
    made = recipe(name)["made"]
    card = f"../reference/models/{name}.md"
    parts = [
        f"# Evidence: {ABOUT[name]['title'].lower()}",
        stamp(name),
        f"Scores of [`{name}`]({card}) on lumps that neither the model nor its intervals had seen. "
        "[How they are measured](../accuracy.md).",
        "## Errors",
        "R2 / median error / share of 90 % intervals that hold (%). E^-2/3 and parts are in their own units.",
        errors_table(scores["held_out"]),
        "Targets missed: " + "; ".join(scores["targets_missed"]) + "."
        if scores["targets_missed"]
        else "Targets met.",
        "## Intervals",
        "Share of 90 % intervals that hold (%). A quarter is of that quantity, smallest first.",
        coverage_table(scores["coverage"]),
        "## Flags",
        flags_table(scores),
    ]
    parts += ["## Two lumps, and tissue of uneven thickness", strange_table(scores["strange"])]
    for extra in scores.get("tables", ()):
        heads = _in_order(extra["rows"][0])
        parts += [
            f"## {extra['title'].split(':')[0]}",
            table(heads, [[r[h] for h in heads] for r in extra["rows"]]),
        ]
    if "detectability" in scores:
        parts += ["## Which lumps are found", _found_table(scores["detectability"])]
    parts += ["## How to write this page again", _again(name, made)]
    return "\n\n".join(parts) + "\n"


def _in_order(row: Scores) -> list[str]:
    first = next((key for key in ("lumps", "place") if key in row), next(iter(row)))
    return [first, *(key for key in row if key != first)]


def _found_table(rows: Sequence[Scores]) -> str:
    body = [(r["d_mm"], r["depth_mm"], r["E"], percent(r["found"]), f"{r['n']:.0f}") for r in rows]
    return table(("d (mm)", "depth (mm)", "E", "found", "strokes"), body)


def _again(name: str, made: Scores) -> str:
    words = ", ".join(f"{key} {value}" for key, value in made.items())
    commands = f"{recipe(name)['command']}\n{COMMAND}"
    return f"Made with: {words}.\n\n<!-- not run: minutes to an hour -->\n```sh\n{commands}\n```"


def _range(ends: Sequence[float | None]) -> str:
    return " to ".join(ABSENT if end is None else f"{end:.3g}" for end in ends)


def card(name: str) -> str:
    """The model's card, a page."""
    about, scores, spec = ABOUT[name], recipe(name)["scores"], load(name)
    row = main_row(scores)
    everywhere, worst = held(scores)
    fat = _range(spec.domain.ranges[OUTPUTS.index("E_fat_kPa")])
    first = "" if spec.first is None else f" after a first stage of {len(spec.first.terms)}"
    facts = [
        ("What for", about["for"]),
        ("Lumps", about["lumps"]),
        ("Tissue", about["tissue"].format(fat=fat, gland=_range(TissueRanges().gland_ratio))),
        ("Force", f"{spec.force_range[0]:g} to {spec.force_range[1]:g} N/m" if spec.force_range else ABSENT),
        ("Array", spec.probe),
        ("Press before the stroke", about["press"]),
        ("Form", f"polynomial of {len(spec.terms)} terms in {len(spec.features)} features{first}"),
        ("Trained on", f"{spec.training['n']} simulated strokes, {spec.training['noise']} noise"),
        ("Training set, SHA-256", f"`{spec.training['hash']}`"),
        ("File, SHA-256", f"`{recipe(name)['sha256']}`"),
        ("Licence", "MIT, as the program"),
    ]
    results = [
        ("Lumps found", percent(found(scores))),
        ("Median error of the diameter", percent(row["d_error"], 1)),
        ("Median error of the depth", percent(row["depth_error"], 1)),
        ("Hard or soft right", percent(row["hard_soft"])),
        ("90 % intervals hold", everywhere),
        ("In the worst quarter of lumps or tissue", worst),
        ("Lumps inside the ranges flagged", percent(scores["flagged_inside"], 1)),
        ("Lumps outside them flagged, of those found", percent(scores["flagged_outside"])),
        ("Plain tissue taken for a lump", percent(scores["false_alarms"], 1)),
    ]
    return "\n\n".join(
        (
            f"# Model `{name}`",
            stamp(name),
            table(("Property", "Value"), facts).replace("| --: |", "| :-- |"),
            "## Features\n\n" + ", ".join(f"`{feature}`" for feature in spec.features) + ". "
            "[What they are](../../features.md).",
            "## How good it is\n\nOne stroke at typical noise, over lumps that it never saw. "
            f"[All scores](../../evidence/{name}.md).",
            table(("Score", "Value"), results),
            f"## Not for\n\n{about['not']} Nobody has tried it on a phantom or a person.",
        )
    ) + "\n"  # fmt: skip


def thesis() -> str:
    """The page on the thesis' Table 1, from its 29 runs as the tests keep them."""
    from palpate.learn.thesis.fit import fit_thesis
    from palpate.learn.thesis.runs import features_table, read_strokes

    names = ("Table 1", "Forward model (Appendix B)", "Inverse model (Appendix C)", "One input at a time")
    names = (*names, "Strain and force", "Why E^-2/3", "Could it be chance?")
    parts = [
        "# Evidence: the thesis' Table 1",
        f"*Written by `{COMMAND} thesis` from the strokes that `palpate sweep --design thesis` makes.*",
        "The thesis kind of model on the thesis' 29 runs, beside the numbers of its Table 1. "
        "*Left out*: each run predicted by an equation that was chosen and fitted without it.",
    ]
    for name, shown in zip(names, fit_thesis(features_table(read_strokes(THESIS_STROKES))).tables()):
        cells = [[str(c).replace("|", "/") for c in column.cells] for column in shown.columns]
        heads = [str(column.header).replace("\n", " ").strip() or " " for column in shown.columns]
        parts += [f"## {name}", table(heads, zip(*cells)), *([f"{shown.caption}."] if shown.caption else [])]
    return "\n\n".join(parts) + "\n"


def pages() -> dict[Path, str]:
    """Every page that follows from the models, as it should be."""
    written = {DOCS / "evidence" / f"{name}.md": evidence(name) for name in NAMES}
    written |= {DOCS / "reference" / "models" / f"{name}.md": card(name) for name in NAMES}
    for page in (ROOT / "README.md", DOCS / "accuracy.md"):
        text, n = TABLE.subn(partial(_replaced, models_table()), page.read_text(encoding="utf-8"))
        if n != 1:
            sys.exit(f"{page.name} has {n} places for the table of models")
        written[page] = text
    return written


def _replaced(text: str, match: re.Match[str]) -> str:
    return f"{match[1]}\n{text}\n\n{match[2]}"


def main(*words: str) -> None:
    """Write the pages, or that of the thesis."""
    if words not in ((), ("thesis",)):
        sys.exit(f"usage: {COMMAND} [thesis]")
    written = {DOCS / "evidence" / "thesis.md": thesis()} if words else pages()
    for path, text in written.items():
        path.write_text(text, encoding="utf-8")
        print(f"wrote {path.relative_to(ROOT)}")
    if not words:
        sys.path.insert(0, str(DOCS))
        import draw_accuracy

        draw_accuracy.main()


if __name__ == "__main__":
    main(*sys.argv[1:])
