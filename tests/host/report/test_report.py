"""The report: one page that needs no other file, the thesis' numbering, its values beside ours."""

from __future__ import annotations

import base64
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import NoSuchFile
from palpate.learn.thesis.fit import fit_thesis
from palpate.learn.thesis.runs import features_table, read_strokes
from palpate.learn.thesis.tables import TABLE_1
from palpate.report import style, write_report
from palpate.sim.tissue import Case, Settings, case_key, read_design, read_table

RUNS = Path(__file__).parent / "data"
"""The thirty strokes, as `palpate sweep --design thesis --out tests/host/report/data` writes them."""
RECORDED = Path(__file__).parents[1] / "recording" / "before_the_press.mcap"
EVERY = [
    "Figure 2", "Figure 6d",
    *(f"Figure {n}" for n in range(7, 22)),
    "Table 1", "Appendix A", "Appendix B", "Appendix C",
]  # fmt: skip

HANG_S = 1500
"""Against a hang: half a minute's work, on a machine that does much else."""
pytestmark = pytest.mark.timeout(HANG_S + 300)


class Page(HTMLParser):
    """What a reader sees: sections by name, their text, images and links."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.sections: dict[str, str] = {}
        self.images: dict[str, bytes] = {}
        self.loads: list[str] = []
        self._now = ""
        self._raised = False
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self._raised = tag == "sup"
        if tag == "section":
            self._now = values["id"]
            self.sections[self._now] = ""
        if tag in ("img", "script", "link", "iframe", "source"):
            source = values.get("src") or values.get("href") or ""
            self.loads.append(source)
            if source.startswith("data:image/png;base64,"):
                self.images[self._now] = base64.b64decode(source.partition(",")[2])

    def handle_data(self, data):
        if self._now and data.strip():
            self.sections[self._now] += ("^" if self._raised else " ") + " ".join(data.split())
        self._raised = False


@pytest.fixture(scope="module")
def strokes():
    return read_strokes(RUNS)


@pytest.fixture(scope="module")
def written(strokes, tmp_path_factory):
    """A whole report by `palpate fit --report`, with a measured map and two measured force curves."""
    folder = tmp_path_factory.mktemp("report")
    x = np.linspace(-25, 25, 40)
    noise = np.random.default_rng(1).normal(0, 0.02, x.size)
    rows = zip(x, 4 + 1.5 * np.exp(-0.5 * (x / 6) ** 2) + noise)
    (folder / "real.csv").write_text("x,p\n" + "".join(f"{a:.3f},{b:.4f}\n" for a, b in rows))
    for name, a in (("soft", 12.0), ("hard", 15.0)):
        lines = "".join(f"{a * s**1.5:.4f},{30 * s:.4f}\n" for s in (0.05, 0.1, 0.15, 0.2))
        (folder / f"{name}.csv").write_text("force,mm\n" + lines)
    done = subprocess.run(
        [sys.executable, "-m", "palpate.cli", "fit", RUNS, "--kind", "thesis", "--out", folder / "model.json",
         "--report", folder / "out", "--recording", folder / "real.csv",
         "--weights", folder / "soft.csv", "--weights", folder / "hard.csv"],
        capture_output=True, text=True, timeout=HANG_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    path = folder / "out" / "index.html"
    return path, Page(path), fit_thesis(features_table(strokes), permutations=0), done


def test_the_kept_strokes_are_those_that_a_sweep_would_write_now():
    """They were an earlier design's: every page and example that should have found them simulated them."""
    keys = [case_key(case, Settings()) for case in read_design("thesis")]
    assert list(read_table(RUNS)["key"]) == keys


def slug(name: str) -> str:
    return name.lower().replace(" ", "_")


def test_every_result_of_the_thesis_is_there_in_its_order(written):
    path, page, _, done = written
    assert list(page.sections) == [slug(name) for name in EVERY]
    for name in EVERY:
        assert "Needs" not in page.sections[slug(name)], name
    assert str(path) in " ".join(done.stderr.split()), "the command says where the report is"
    assert "Table 1" in done.stdout


def test_the_report_says_what_it_is_at(tmp_path):
    told: list[str] = []
    write_report(tmp_path / "out", simulate=False, progress=told.append)
    assert [name for name in told if name in EVERY][-len(EVERY) :] == EVERY


def test_exponents_are_raised_in_figures_and_tables_and_nothing_else_is_touched():
    assert style.powers("E^-2/3, R2 0.98") == "E$^{-2/3}$, R$^2$ 0.98"
    assert style.powers_html("stiffness E^(-2/3)") == "stiffness E<sup>&minus;2/3</sup>"
    assert style.powers_html("F^-1.1 (R2 1) &lt;b&gt; (ln h)^2") == (
        "F<sup>&minus;1.1</sup> (R<sup>2</sup> 1) &lt;b&gt; (ln h)<sup>2</sup>"
    )
    assert style.powers("d10h08e10f10: R20") == "d10h08e10f10: R20"


def test_the_page_needs_no_other_file_and_no_network(written):
    path, page, _, _ = written
    assert all(source.startswith("data:") for source in page.loads)
    assert not re.search(r"https?://", path.read_text("utf-8").replace("http://www.w3.org", ""))


def test_each_figure_is_kept_as_png_and_svg(written):
    path, page, _, _ = written
    for name in (name for name in EVERY if name.startswith("Figure")):
        png, svg = path.parent / f"{slug(name)}.png", path.parent / f"{slug(name)}.svg"
        assert png.read_bytes() == page.images[slug(name)]
        assert png.read_bytes().startswith(b"\x89PNG") and svg.read_bytes().startswith(b"<?xml")


def test_table_1_shows_the_thesis_values_beside_ours(written):
    _, page, fit, _ = written
    text = page.sections["table_1"]
    for row in TABLE_1:
        for displacement in (False, True):
            entry = fit.entry(row.target, row.runs, displacement)
            assert f"{entry.direct.r2_in:.3f}" in text and f"{entry.direct.r2_loo:.3f}" in text
            if entry.thesis_r2 is not None:
                assert f"{entry.thesis_r2:.3f}" in text


def test_table_1_marks_the_equation_to_use_as_the_thesis_does(written):
    text = written[1].sections["table_1"]
    for starred in ("0.999 *", "0.990 *", "0.925 *", "0.824 *", "0.957 *", "0.724 *", "0.981 *"):
        assert starred in text
    assert "0.800 *" not in text and "0.882 *" not in text
    assert "h (E >= 10) from" in text, "why pressure alone is better there stands beside"


def test_appendix_a_lists_every_run(written, strokes):
    text = written[1].sections["appendix_a"]
    assert all(stroke.code in text for stroke in strokes)
    assert "30, of which 29 linear" in text


def test_what_the_thesis_says_stands_beside_what_came_out(written):
    sections = written[1].sections
    assert "about 3000" in sections["figure_6d"]
    assert "Curvature ~ F^−1.1" in sections["figure_13"]
    assert "−0.343 without F = 0.2" in sections["figure_13"].replace("-0.343", "−0.343")
    assert "D0 goes against physics" in sections["appendix_b"]
    assert re.search(r"up to 20 % 19\.\d %", sections["figure_8"])
    slope = re.search(r"force at equal strain grows with E yes (yes|no)", sections["figure_15"])
    assert slope is not None and slope[1] == "yes"
    low_thesis, low, high_thesis, high = re.findall(r"like E = ([\d.]+)", sections["figure_15"])
    assert (low_thesis, high_thesis) == ("1", "10")
    assert 1.5 < float(low) < 5.0 < float(high)


def test_measured_curves_are_placed_among_the_simulated_ones(written):
    text = written[1].sections["figure_21"]
    soft, hard = (float(v) for v in re.findall(r"like E = ([\d.]+)", text))
    assert soft < hard


def test_without_data_the_report_says_what_would_make_each_part(tmp_path):
    page = Page(write_report(tmp_path / "out", simulate=False))
    assert list(page.sections) == [slug(name) for name in EVERY]
    assert "palpate sweep --design thesis" in page.sections["figure_12"]
    assert "--report DIR" in page.sections["table_1"]
    assert (
        "--recording FILE" in page.sections["figure_20"] or "Needs a recording" in page.sections["figure_20"]
    )
    drawn = {f"figure_{n}" for n in ("6d", "7")}
    assert set(page.images) == drawn, "what needs no strokes is drawn without them"


def test_a_map_in_two_dimensions_is_highest_over_the_lump(written):
    text = written[1].sections["figure_2"]
    along, across = (int(v) for v in re.search(r"highest (-?\d+) mm along, (-?\d+) mm across", text).groups())
    assert abs(along) <= 1 and abs(across) <= 1
    assert "a simulated ball" in text, "nobody takes it for a real tumour"


def test_a_recording_gives_figure_2_its_own_map():
    from palpate.report.recording_figures import figure_2, recorded_map_2d

    found = recorded_map_2d(RECORDED)
    assert (
        found.pressure_kPa.shape == (len(found.along_mm), 26) == (len(found.along_mm), len(found.across_mm))
    )
    middle = found.pressure_kPa.mean(1)
    assert 10 < middle.argmax() < len(middle) - 10 and RECORDED.name in found.whose
    assert len(figure_2(found).axes) == 3


def test_the_same_data_give_the_same_files(tmp_path):
    first = write_report(tmp_path / "a", simulate=False)
    second = write_report(tmp_path / "b", simulate=False)
    for file in sorted(first.parent.iterdir()):
        assert file.read_bytes() == (second.parent / file.name).read_bytes(), file.name


def test_a_recording_that_is_not_there_is_named(tmp_path):
    with pytest.raises(NoSuchFile, match=r"nowhere\.csv"):
        write_report(tmp_path / "out", simulate=False, recording="nowhere.csv")


def test_figure_8_shows_the_tissue_giving_way():
    from palpate.sim.tissue.deformation import deformation

    case = Case.from_code("d10h08e10f10")
    mesh, (far, over) = deformation(case, (-28.0, 0.0))
    assert 0.18 < far.displacement_mm / case.t_mm < 0.21
    surface = far.nodes_mm[mesh.surface]
    under = surface[np.abs(surface[:, 0] - far.position_mm) < 2.0]
    face = np.interp(under[:, 0], far.face_mm[:, 0], far.face_mm[:, 1])
    assert np.abs(under[:, 1] - face).max() < 0.02
    assert over.image_kPa.argmax() in (7, 8) and over.displacement_mm < far.displacement_mm
