"""What a device or a file says is shown, and commands no terminal."""

import json
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate import console
from palpate.cli.runner import sentence
from palpate.cli.stream import LOGS_A_SECOND, ShownLogs
from palpate.errors import NotAProbe
from palpate.wire.events import Log

HOST = Path(console.__file__).parent
HOSTILE = "\x1b]0;owned\x07\x1b[2J\rpalpate: done\n\x9b31m\x7f\u202egpj.exe\u2028\udc80"


@given(st.text())
def test_what_is_shown_holds_no_control_characters_and_hides_nothing(text):
    shown = console.printable(text)
    assert not re.search(r"[\x00-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\ud800-\udfff]", shown)
    assert console.printable(shown) == shown
    assert shown == text or not text.isprintable()


def test_a_probes_words_reach_the_terminal_without_its_escape_codes(capsys):
    """85,392 escape bytes came through in one stream, and retitled the window."""
    console.note(HOSTILE)
    console.say(HOSTILE)
    console.table(("port", "what"), [(HOSTILE, "[link=file:///etc/passwd]here[/link]")])
    shown = "".join(capsys.readouterr())
    assert "\\x1b]0;owned\\x07" in shown
    assert "[link=file" in shown  # no markup of its own either
    assert not set(shown) & {"\x1b", "\x07", "\r", "\x9b", "\x7f", "\u202e", "\u2028"}


def test_an_errors_sentence_and_a_json_document_have_none_either(capsys):
    assert "\x1b" not in sentence(NotAProbe(f"it says: {HOSTILE}"))
    console.print_json({"serial": HOSTILE, "unit": "°"})
    shown = capsys.readouterr().out
    assert shown.isprintable() or shown.rstrip("\n").isprintable()
    assert json.loads(shown) == {"serial": HOSTILE, "unit": "°"}
    assert "°" in shown


def test_a_chatty_probe_gets_ten_lines_a_second():
    shown = ShownLogs()
    second = 1_000_000_000
    lines = [
        line
        for k in range(3000)
        for line in shown.lines(Log(5 * second + k * second // 1000, 0, 0, f"{k}\x1b\nflashed"))
    ]
    told = [line for line in lines if "not shown" in line]
    assert len(lines) - len(told) == 3 * LOGS_A_SECOND
    assert told == ["  probe: 990 more lines, not shown"] * 2
    assert lines[0] == "  probe: 0\\x1b\\nflashed"


@pytest.mark.parametrize("path", sorted((HOST / "cli").glob("*.py")), ids=lambda path: path.stem)
def test_every_command_prints_through_the_console(path):
    text = path.read_text(encoding="utf-8")
    assert path.stem == "completion" or not re.search(
        r"\bclick\.s?echo\(|\bprint\(", text.replace(".print(", "")
    )
