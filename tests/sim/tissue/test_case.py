"""A case says what is simulated, and its code says it exactly."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.sim.tissue import THESIS_CODES, Case, CaseError, Settings, case_key, read_design, sobol_cases


def test_the_thesis_codes_are_thirty_and_read_back_as_written():
    assert len(set(THESIS_CODES)) == 30
    assert [Case.from_code(code).code for code in THESIS_CODES] == list(THESIS_CODES)


def test_the_reference_code_means_what_the_thesis_says():
    case = Case.from_code("d10h08e10f10")
    assert (case.d_mm, case.h, case.E_ratio, case.t_mm, case.F_N_per_m) == (10, 0.8, 10, 13, 100)
    assert Case.from_code("d10h08e1Kf02").E_ratio == 1000
    assert Case.from_code("d10h08eNLf10").nonlinear_lump


@given(
    d=st.floats(0.5, 100),
    h=st.floats(0.02, 50),
    E=st.floats(0.01, 1e6),
    F=st.floats(1e-3, 100),
    radius=st.one_of(st.just(math.inf), st.floats(5, 1000)),
    friction=st.floats(0, 0.5),
    stiffening=st.floats(0, 2000),
)
def test_every_case_has_a_code_that_reads_back_as_exactly_that_case(d, h, E, F, radius, friction, stiffening):
    case = Case(d, h, E, F, probe_radius_mm=radius, friction=friction, gland_stiffening=stiffening)
    assert Case.from_code(case.code) == case


@pytest.mark.parametrize(
    "code",
    ["", "d10h08e10", "d10h08e10f10x", "d10h8e10f10", "dxxh08e10f10", "d10h08e10f10_Q3", "d00h08e10f10",
     "d10h08e10f10_mu0.9", "d10h08enanf10", "d10h08e10f10_R",
     "d10h08e10f10_R60_R40", "d10h08eNLf10_sl5",  # said twice: the last one won
     "d\u0661\u0660h08e10f10", "d10h08e10f10_R\uff16\uff10"],  # other scripts' digits
)  # fmt: skip
def test_a_wrong_code_is_refused_in_one_sentence(code):
    with pytest.raises(CaseError) as error:
        Case.from_code(code)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, 0.0, None, "ten"])
def test_a_diameter_that_makes_no_sense_is_refused(value):
    with pytest.raises(CaseError, match="d_mm"):
        Case(value, 0.8, 10)


@pytest.mark.parametrize("t", [4.0, 13.0, 40.0])
def test_a_case_without_a_lump_has_the_thickness_asked_for(t):
    case = Case.without_lump(t, 0.5)
    assert not case.has_lump
    assert case.t_mm == pytest.approx(t)


def test_a_key_names_case_and_settings():
    case = Case.from_code("d10h08e10f10")
    keys = {
        case_key(case, Settings()),
        case_key(case, Settings(hx_mm=1.0)),
        case_key(case, Settings(press_only=True)),
        case_key(case, Settings(start_mm=-30.0)),
        case_key(Case.from_code("d10h08e10f09"), Settings()),
    }
    assert len(keys) == 5
    assert case_key(Case(10, 0.8, 10, 1), Settings()) == case_key(case, Settings())


def test_designs_are_read_and_seeded(tmp_path):
    assert len(read_design("thesis")) == 30
    assert read_design("sobol:20:3") == sobol_cases(20, 3) == sobol_cases(64, 3)[:20]
    assert read_design("sobol:20:4") != read_design("sobol:20:3")
    assert all(5 <= c.d_mm <= 20 and 2 <= c.E_ratio <= 1000 for c in read_design("sobol:64"))
    (tmp_path / "codes.txt").write_text("# mine\nd10h08e10f10\nd12.3h0.85e7.4f0.66\n")
    (tmp_path / "cases.csv").write_text("d_mm,h,E_ratio,F_rel\n10,0.8,10,1\n")
    assert len(read_design(str(tmp_path / "codes.txt"))) == 2
    assert read_design(str(tmp_path / "cases.csv")) == [Case.from_code("d10h08e10f10")]


@pytest.mark.parametrize("design", ["sobol", "sobol:0", "sobol:x:1", "sobol:3:4:5", "nonsense"])
def test_a_wrong_design_is_refused(design):
    with pytest.raises(CaseError):
        read_design(design)


def test_a_file_of_cases_names_the_line_that_is_wrong(tmp_path):
    (tmp_path / "cases.csv").write_text("d_mm,h,E_ratio\n10,0.8,10\n10,none,10\n")
    with pytest.raises(CaseError, match="line 3"):
        read_design(str(tmp_path / "cases.csv"))
    (tmp_path / "other.csv").write_text("d_mm,height\n10,0.8\n")
    with pytest.raises(CaseError, match="height"):
        read_design(str(tmp_path / "other.csv"))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("d_mm,h,E_ratio,F_rel\n10,0.8,5,1,7\n", "line 2: 5 cells for 4 columns"),
        ("d_mm,h,E_ratio,F_rel\n10,0.8,5\n", "line 2: 3 cells for 4 columns"),
        ("d_mm,h,E_ratio,h\n10,0.8,5,0.9\n", "a column twice: h"),
        ("d10h08e10f10\nxx\n", "cases.csv: 'xx' is not a case code"),
    ],
)
def test_a_file_of_cases_that_cannot_be(tmp_path, text, sentence):
    (tmp_path / "cases.csv").write_text(text)
    with pytest.raises(CaseError, match=sentence):
        read_design(str(tmp_path / "cases.csv"))
