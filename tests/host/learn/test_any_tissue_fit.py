"""`palpate fit --kind field`: from an empty directory to a model that is not told its tissue."""

import json

import pytest
from click.testing import CliRunner

from palpate.cli import fit
from palpate.errors import UsageError
from palpate.learn.cylinders import fit_to_cylinders
from palpate.learn.data import prepare_strokes
from palpate.learn.probe_model import OUTPUTS as OURS
from palpate.learn.scopes import ANYWHERE, ESTIMATES, TOLD
from palpate.learn.table import TableError
from palpate.model_export import exporter
from palpate.model_export import image_builder as image
from palpate.model_export.schema import ModelSpec
from palpate.report import held_out_figures
from palpate.wire.events import OUTPUTS
from tests.docs.test_reference import fields_in_the_page
from tests.host.learn.conftest import STROKES

LUMPS = 6


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    """Far too few lumps for a good model: enough for every step."""
    home = tmp_path_factory.mktemp("any")
    prepare_strokes(home, LUMPS, workers=1)
    return home


@pytest.fixture(scope="module")
def anywhere(tmp_path_factory):
    """As few lumps that need not lie on the border."""
    home = tmp_path_factory.mktemp("anywhere")
    prepare_strokes(home, LUMPS, workers=1, scope=ANYWHERE)
    return home


@pytest.fixture(scope="module")
def fitted(directory):
    said = []
    result = fit_to_cylinders(
        prepare_strokes(directory, LUMPS), others=(), progress=lambda *words: said.append(words)
    )
    return result, said


def test_one_command_prints_one_json_document_and_writes_a_model_of_two_stages(directory, tmp_path):
    out = tmp_path / "m.json"
    words = [str(directory), "--kind", "field", "--out", str(out), "--json"]
    result = CliRunner().invoke(fit.command, words)
    assert result.exception is None, result.output
    said = json.loads(result.stdout)
    assert set(said) == fields_in_the_page("fit-field")
    assert [row["setting"] for row in said["held_out"]] == [
        f"{noise}, {with_what}"
        for noise in ("typical", "real")
        for with_what in ("the stroke alone", "with its press")
    ]
    spec = ModelSpec.load(out)
    assert [e.name for e in spec.first.estimates] == list(ESTIMATES)
    assert spec.training["tissue"] == "any" and spec.training["lumps"] == LUMPS


def test_the_model_has_room_on_the_probe_and_is_a_function_of_the_press(fitted):
    result, _ = fitted
    assert tuple(o.name for o in result.spec.outputs) == OUTPUTS and len(OURS) == len(OUTPUTS)
    prepared, _, force_map = exporter.prepare(result.spec)
    assert len(image.build(result.spec, prepared, force_map, counter=1)) < 9000
    assert result.spec.first.joining is not None, "a reference press joins the stroke's own"
    assert [e.name for e in result.spec.checks.estimates] == ["two_lumps", "uneven_tissue"]


def test_every_lump_is_judged_by_models_that_have_not_seen_it(fitted):
    result, said = fitted
    assert set(result.study.seen.group) <= set(range(LUMPS))
    assert len(result.tables()) == 6 and result.missed_targets()
    assert said[-1][1] == said[-1][2], "progress ends where it said that it would"
    for item in held_out_figures.items(result):
        assert item.draw().axes and item.tables


def test_strokes_in_one_tissue_and_of_all_kinds_are_not_taken_for_each_other(directory, tmp_path):
    with pytest.raises(TableError, match="strokes in one tissue; say which"):
        prepare_strokes(STROKES)
    with pytest.raises(TableError, match="tissue of all kinds; leave --tissue out"):
        prepare_strokes(directory, scope=TOLD)
    words = [str(STROKES), "--kind", "field", "--without", "displacement", "--out", str(tmp_path / "m.json")]
    result = CliRunner().invoke(fit.command, words)
    assert isinstance(result.exception, UsageError) and "add --tissue thesis" in str(result.exception)


def test_lumps_that_lie_anywhere_are_known_and_their_model_tells_the_layer(anywhere, directory, tmp_path):
    out = tmp_path / "m.json"
    words = ["--kind", "field", "--out", str(out), "--json"]
    result = CliRunner().invoke(fit.command, [str(anywhere), *words, "--report", str(tmp_path / "report")])
    assert result.exception is None, result.output
    assert "at the border" in (tmp_path / "report" / "index.html").read_text("utf-8")
    said = json.loads(result.stdout)
    assert set(said) == fields_in_the_page("fit-field") | {"tables"}
    assert [table["title"].split(":")[0] for table in said["tables"]] == [
        "Lumps anywhere, held out",
        "Where the lump lies (rows), and where it is said to lie",
        "Size and stiffness",
    ]
    spec = ModelSpec.load(out)
    assert spec.training["place"] == "any" and spec.layers is not None
    ranges = dict(zip(OUTPUTS, spec.domain.ranges))
    assert ranges["h"][1] is None or ranges["h"][1] > 2, "the border's own end is 1.5"
    prepared, _, force_map = exporter.prepare(spec)
    assert len(image.build(spec, prepared, force_map, counter=1)) < 9000
    result = CliRunner().invoke(fit.command, [str(directory), "--anywhere", *words])
    assert isinstance(result.exception, TableError) and "on the border" in str(result.exception)
    result = CliRunner().invoke(fit.command, [str(anywhere), "--anywhere", "--tissue", "thesis", *words])
    assert isinstance(result.exception, UsageError) and "no --tissue" in str(result.exception)
