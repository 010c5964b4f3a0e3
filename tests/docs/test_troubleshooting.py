"""Every message that the troubleshooting page explains is one that the product gives, word for word."""

import ast
import re

import pytest

from tests.docs.blocks import DOCS, ROOT

PAGE = DOCS / "troubleshooting.md"
ROOMS = ("host", "firmware_py", "model_export", "sim")
PLACE = "\0"
"""Stands in a template for what is filled in."""


def templates() -> str:
    """All texts in the rooms' code and in the viewer's page, what is filled in left open."""
    found = []
    for path in (path for room in ROOMS for path in (ROOT / room).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.JoinedStr):
                found.append(
                    "".join(str(v.value) if isinstance(v, ast.Constant) else PLACE for v in node.values)
                )
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
    found += [path.read_text(encoding="utf-8") for path in (ROOT / "host/view/page").glob("*.js")]
    return re.sub(r"%[sd]|[ \n]+", lambda m: PLACE if m[0].startswith("%") else " ", "\n".join(found))


TEMPLATES = templates()
QUOTED = re.findall(r"\*\*[“\"](.+?)[”\"]", PAGE.read_text(encoding="utf-8"))


def pieces(message: str) -> list[str]:
    """The words of a quoted message between what stands for something else: `...`, CAPITALS, numbers."""
    parts = re.split(r"\.\.\.|, |\b[A-Z]{3,}\b|\d+(?:\.\d+)?|'\w+'", message)
    return [part.strip(" ,.;:'`()") for part in parts if re.search(r"\w{3}", part)]


@pytest.mark.parametrize("message", QUOTED)
def test_a_message_of_the_page_is_given_by_the_product(message):
    wanted = pieces(message)
    assert wanted
    missing = [piece for piece in wanted if piece.lower() not in TEMPLATES.lower()]
    assert not missing, f"nothing says {missing}"


def test_the_page_covers_ports_flashing_recordings_keys_and_the_viewer():
    assert len(QUOTED) >= 30
    assert not [q for q in ("there is no such sentence",) if q in TEMPLATES], "the test could not fail"
