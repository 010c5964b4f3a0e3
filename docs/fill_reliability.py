"""Write docs/reliability.md from what campaigns have left: `python docs/fill_reliability.py`.

`make mutants` leaves docs/evidence/mutants.json, `make test-long` docs/evidence/campaigns.jsonl: a line for
each test that counted something. The last line of a test holds; a long test's stands before a short one's.
"""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
PAGE = DOCS / "reliability.md"
MUTANTS = DOCS / "evidence" / "mutants.json"
CAMPAIGNS = DOCS / "evidence" / "campaigns.jsonl"
TRIED_BY = DOCS.parent / "tests" / "mutants.toml"
SURVIVORS = DOCS.parent / "tests" / "survivors.toml"

EXPORT, FIRMWARE, HOST = "tests/model_export/", "tests/firmware_py/", "tests/host/"
TABLES: dict[str, list[tuple[str, str, str]]] = {
    "Cuts of power": [
        (
            "an update of the model, cut at every byte, and again while it recovers",
            "the old or the new model, whole and signed",
            f"{EXPORT}test_power_cuts.py::test_an_update_survives_every_cut_and_every_second_cut[{{1|97}}]",
        ),
        (
            "the next update, back into the first slot",
            "as above",
            f"{EXPORT}test_power_cuts.py::test_a_later_update_back_into_the_first_slot_survives_too[{{3|997}}]",
        ),
        (
            "the first model of all",
            "whole or not there",
            f"{EXPORT}test_power_cuts.py::test_the_first_model_of_all_is_there_whole_or_not_at_all",
        ),
        (
            "a calibration of 1,700 bytes",
            "the old or the new one",
            f"{EXPORT}test_record_cuts.py::test_a_calibration_survives_every_cut",
        ),
    ],
    "Bit flips": [
        (
            "bits of a thesis image (a small set of parameters)",
            "none accepted",
            f"{EXPORT}test_flips.py::test_bits_of_a_thesis_image[{{1|5}}]",
        ),
        (
            "every bit of a field image",
            "none accepted",
            f"{EXPORT}test_flips.py::test_every_bit_of_a_field_image_with_the_default_key",
        ),
        (
            "bits of the live image on the probe",
            "told; the other slot serves",
            f"{EXPORT}test_rot.py::test_a_damaged_live_image_is_told_and_the_one_before_serves[{{1|331}}]",
        ),
        (
            "bits of a copy of the calibration",
            "repaired or told",
            f"{EXPORT}test_rot.py::test_no_flip_in_a_copy_of_the_calibration_changes_it[cal0-{{1|37}}]",
        ),
        (
            "bits of a copy of the keys",
            "repaired or told",
            f"{EXPORT}test_rot.py::test_no_flip_in_a_copy_of_the_keys_changes_whose_models_are_taken"
            "[key0-{1|29}]",
        ),
        (
            "bits of a copy of the settings",
            "repaired and told",
            f"{FIRMWARE}test_damage.py::test_a_flip_in_a_copy_is_repaired_and_told_once[set0-{{1|7}}]",
        ),
        (
            "every 97th bit of a recording that was never closed",
            "at most a frame lost",
            f"{HOST}recording/test_damage.py::test_rot_at_every_97th_bit[killed]",
        ),
        (
            "every 97th bit of a sealed recording",
            "told",
            f"{HOST}recording/test_damage.py::test_rot_at_every_97th_bit[sealed]",
        ),
    ],
    "Floods": [
        (
            "packets damaged one by one, 12 to 641 bytes long",
            "none accepted",
            f"{FIRMWARE}test_packets.py::test_a_million_damaged_packets_and_none_is_accepted",
        ),
        (
            "noise to the probe's parser",
            "buffer as before",
            f"{FIRMWARE}test_packets.py::test_ten_million_inputs_neither_crash_nor_hang[Receiver]",
        ),
        (
            "changed packets to the host's parser",
            "no frame but the true ones",
            f"{HOST}link/test_fuzz.py::test_ten_million_changed_packets",
        ),
        (
            "guided fuzzing of both parsers, the messages and a whole probe",
            "no crash, no hang, under 1 GB",
            f"{FIRMWARE}test_parser_fuzz.py::test_four_minutes_of_fuzzing_find_nothing",
        ),
        (
            "an hour of frames over a line that loses 0.1 % of the bytes",
            "every loss counted",
            f"{HOST}link/test_parser.py::test_an_hour_of_streaming",
        ),
        (
            "an hour of frames and strokes, on MicroPython",
            "the heap as it was",
            f"{FIRMWARE}test_an_hour.py::test_an_hour_of_frames_and_strokes_leaves_the_heap_as_it_was",
        ),
        (
            "24 h of frames, counters begun just before their wrap",
            "in order",
            f"{FIRMWARE}test_commands.py::test_a_day_of_simulated_time",
        ),
    ],
}
HEAD = """# Reliability

What was done to Palpate on purpose, how often, and what came of it. Every row is a test; the counts are
what it printed.

<!-- python docs/fill_reliability.py writes this page -->
"""
MUTANTS_SAY = """
## Faults in the source

Would the tests notice if the source were wrong? `make mutants` changes one thing at a time in a copy of the
source (an operator, a number, a comparison, a call left out; in numerical kernels a result that is 1 % off)
and runs the module's tests. *Equivalent* changes nothing that anyone can see, and counts for neither side.
`tests/survivors.toml` says of each survivor why it stands.

{drawn}. *At first* is the share that the tests killed before anybody had looked at the sample, so it is what
to expect of other faults. *Now* is the share after tests were written for what got past.

| module | tried | equivalent | killed at first | now |
|---|---|---|---|---|
"""
FOOT = """
The power of the emulated board was cut, too: [the reference board](evidence/board.md).
[What the link survives](link.md) has each fault on the line, and what it does to frames and models.

```text title="what prints and keeps the figures"
make test-long mutants
python docs/fill_reliability.py
```
"""


def mutants() -> str:
    """The table of mutants."""
    kept: dict[str, dict[str, Any]] = json.loads(MUTANTS.read_text("utf-8"))
    known = tomllib.loads(SURVIVORS.read_text("utf-8"))["survivor"]
    same = {(one["module"], one["was"], one["now"]) for one in known if "equivalent" in one}
    lines, together = [], [0, 0, 0, 0]
    for module, one in sorted(kept.items()):
        passed = [
            [pair for pair in one[when] if (module, *pair) not in same] for when in ("at_first", "survivors")
        ]
        equivalent = len(one["at_first"]) - len(passed[0])
        tried = one["tried"] - equivalent
        row = [tried, equivalent, *(tried - len(pairs) for pairs in passed)]
        together = [a + b for a, b in zip(together, row)]
        lines.append(_row(f"`{module}`", *row))
    untried = [f"`{name}`" for name in tomllib.loads(TRIED_BY.read_text("utf-8")) if name not in kept]
    rest = f"\nNot run yet: {', '.join(untried)}.\n" if untried else ""
    head = MUTANTS_SAY.format(drawn="; ".join(drawn_by(kept)))
    return head + "\n".join([*lines, _row("**all**", *together)]) + "\n" + rest


def drawn_by(kept: dict[str, dict[str, Any]]) -> list[str]:
    """How the samples were drawn, and when: the command of each."""
    found: dict[str, list[str]] = {}
    for one in kept.values():
        size = f"--sample {one['sample']}" if one["sample"] else "--all"
        command = f"`python -m tests.mutants --seed {one['seed']} {size} --write`"
        found.setdefault(command, []).append(one["date"])
    return [
        f"{command} drew those of {len(dates)} modules, {' to '.join(sorted({min(dates), max(dates)}))}"
        for command, dates in sorted(found.items())
    ]


def _row(name: str, tried: int, equivalent: int, at_first: int, now: int) -> str:
    shares = (f"{killed} ({killed / max(1, tried):.0%})" for killed in (at_first, now))
    return f"| {name} | {tried} | {equivalent} | {' | '.join(shares)} |"


def counted() -> dict[str, str]:
    """What each test counted last."""
    lines = [json.loads(line) for line in CAMPAIGNS.read_text("utf-8").splitlines()]
    return {one["test"]: one["counted"] for one in lines}


def last_of(test: str, known: dict[str, str]) -> str:
    """The count of a test; `[{long|short}]` stands for either parameter."""
    head, brace, rest = test.partition("{")
    names = (
        [head + name + rest.partition("}")[2] for name in rest.partition("}")[0].split("|")]
        if brace
        else [test]
    )
    for name in names:
        if name in known:
            return known[name]
    return "not run yet"


def page() -> str:
    """The whole page."""
    known = counted()
    parts = [HEAD]
    for title, rows in TABLES.items():
        parts.append(f"\n## {title}\n\n| what | counted | what came of it |\n|---|---|---|\n")
        parts += [f"| {what} | {with_commas(last_of(test, known))} | {came} |\n" for what, came, test in rows]
    return "".join([*parts, mutants(), FOOT])


def with_commas(text: str) -> str:
    """Numbers of five digits and more, as people read them."""
    return " ".join(
        f"{int(word):,}" if word.isdigit() and len(word) > 4 else word for word in text.split(" ")
    )


def compact() -> None:
    """Keep a line a test."""
    lines = [json.dumps({"test": test, "counted": said}) for test, said in sorted(counted().items())]
    CAMPAIGNS.write_text("\n".join(lines) + "\n", "utf-8")


if __name__ == "__main__":
    compact()
    PAGE.write_text(page(), "utf-8")
    print(f"{PAGE.relative_to(DOCS.parent)} written")
