"""`palpate compile`: a fitted regression from a file becomes a file for a microcontroller."""

import ast
import json
import pickle

import joblib
import numpy as np
import pandas as pd
import pytest
import skops.io
import statsmodels.api as sm
from sklearn.linear_model import LinearRegression, LogisticRegression, Ridge
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, PolynomialFeatures, StandardScaler

from firmware_py import signature
from firmware_py import status as status_of
from palpate.model_export.signing import keys
from tests.host.cli.sentences import one_sentence

RNG = np.random.default_rng(0)
X = pd.DataFrame(RNG.uniform(0, 10, (200, 3)), columns=["a", "b", "c"])
Y = X["a"] ** 2 + X["b"] * X["c"]


class Runs:
    """What a hostile pickle is: it runs something when it is read."""

    def __reduce__(self):
        return print, ("it was run",)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Models and tables by their names."""
    place = tmp_path_factory.mktemp("models")
    X.assign(d_mm=Y).to_csv(place / "train.csv", index=False)
    X.assign(d_mm=Y).to_parquet(place / "train.parquet")
    X.iloc[:, ::-1].assign(d_mm=Y + 1, d2_mm=-Y).to_csv(place / "more.csv", index=False, sep=";", decimal=",")
    X.assign(a=np.nan).to_csv(place / "holes.csv", index=False)
    X.assign(a="many").to_csv(place / "words.csv", index=False)
    X[:0].to_csv(place / "heads.csv", index=False)
    scaled = make_pipeline(StandardScaler(), PolynomialFeatures(2), Ridge()).fit(X, Y)
    skops.io.dump(scaled, place / "model.skops")
    joblib.dump(scaled, place / "model.joblib")
    skops.io.dump(
        make_pipeline(FunctionTransformer(np.log1p), Ridge()).fit(X.to_numpy(), Y), place / "no.skops"
    )
    skops.io.dump(Ridge().fit(X, np.c_[Y, -Y]), place / "two.skops")
    skops.io.dump(LogisticRegression().fit(X, Y > 50), place / "class.skops")
    skops.io.dump(MLPRegressor(max_iter=5).fit(X, Y), place / "network.skops")
    skops.io.dump(make_pipeline(StandardScaler(), Ridge()), place / "unfitted.skops")
    skops.io.dump({"made by": ast.AST()}, place / "strange.skops")
    (place / "results.pkl").write_bytes(pickle.dumps(sm.OLS(Y, sm.add_constant(X)).fit()))
    (place / "hostile.pkl").write_bytes(pickle.dumps(Runs()))
    lost = LinearRegression().fit(X, Y)
    lost.coef_[1] = np.nan
    skops.io.dump(lost, place / "lost.skops")
    for name in ("text.skops", "text.pkl", "text.parquet"):
        (place / name).write_text("hello")
    return place


def test_a_model_in_skops_format_becomes_a_module(palpate, files, tmp_path):
    status, out, err = palpate(
        "compile", files / "model.skops", "--data", files / "train.csv", "--out", tmp_path / "m.py"
    )
    assert status == 0 and out.strip() == str(tmp_path / "m.py")
    assert "bits below 2^30" in err and "y over X (n = 200): worst" in err and "bytes" in err
    space: dict = {}
    exec((tmp_path / "m.py").read_text(), space)
    found = [0]
    space["predict"]([round(v / float(s)) for v, s in zip((2.0, 3.0, 4.0), space["STEPS"])], found)
    model = skops.io.load(files / "model.skops", trusted=[])
    want = model.predict(pd.DataFrame([[2.0, 3.0, 4.0]], columns=["a", "b", "c"]))[0]
    assert found[0] * float(space["UNIT_OF"][0]) == pytest.approx(want, abs=1e-3)


def test_a_module_is_signed_for_boards_that_ask(palpate, files, tmp_path, real_key_dir, public_key):
    """Nothing that is signed so can be taken for a probe's model."""
    words = ("compile", files / "model.skops", "--data", files / "train.csv", "--out")
    assert palpate(*words, tmp_path / "plain.mpy")[0] == 0
    assert palpate(*words, tmp_path / "signed.mpy", "--key", real_key_dir)[0] == 0
    plain, signed = ((tmp_path / name).read_bytes() for name in ("plain.mpy", "signed.mpy"))
    assert signed.startswith(plain)

    status, _, err = palpate(*words, tmp_path / "unsigned.mpy", "--key", tmp_path)
    assert status == 1 and "holds no signing key" in err and not (tmp_path / "unsigned.mpy").exists()

    def verified(data, context):
        return signature.verify(public_key, lambda at, n: data[at : at + n], len(data), context)

    assert verified(signed, keys.PROGRAM) == status_of.OK
    assert verified(signed, signature.MODEL) == status_of.BAD_SIGNATURE
    assert verified(signed[:50] + b"\xff" + signed[51:], keys.PROGRAM) == status_of.BAD_SIGNATURE


@pytest.mark.parametrize("name", ["m.c", "m.h", "m.mpy", "m.py"])
def test_the_suffix_says_what_is_written(palpate, files, tmp_path, name):
    status, out, _ = palpate(
        "compile", files / "model.joblib", "--trust", "--data", files / "train.parquet", "--out",
        tmp_path / name, "--json",
    )  # fmt: skip
    told, data = json.loads(out), (tmp_path / name).read_bytes()
    assert status == 0 and told["bytes"] == len(data) and 0 < told["headroom_bits"] < 30
    starts = {".c": b"/* A regression", ".h": b"/* A regression", ".mpy": b"M\x06", ".py": b'"""A regression'}
    assert data.startswith(starts[name[1:]])


def test_intervals_come_of_rows_that_the_model_has_not_seen(palpate, files, tmp_path):
    """Whose columns may stand in another order, with other separators."""
    status, out, _ = palpate(
        "compile", files / "model.skops", "--data", files / "train.csv", "--out", tmp_path / "m.c", "--json",
        "--target", "d_mm", "--calibrate", files / "more.csv", "--unit", "mm",
    )  # fmt: skip
    outputs = json.loads(out)["outputs"]
    assert status == 0 and [o["name"] for o in outputs] == ["d_mm", "d_mm_low", "d_mm_high", "inside"]
    assert [o["unit"] for o in outputs] == ["mm", "mm", "mm", ""]


@pytest.mark.parametrize("words", [("no.skops", "--target", "d_mm"), ("class.skops",), ("two.skops",)])
def test_other_kinds(palpate, files, tmp_path, words):
    name, *more = words
    got, _, err = palpate(
        "compile", files / name, "--data", files / "train.csv", "--out", tmp_path / "m.py", *more
    )
    assert got == 0, err


def test_results_of_statsmodels(palpate, files, tmp_path):
    words = ("--data", files / "train.csv", "--out", tmp_path / "m.py", "--trust")
    assert palpate("compile", files / "results.pkl", *words)[0] == 0


def test_a_pickle_is_not_read_without_trust(palpate, files, tmp_path):
    words = ("compile", files / "hostile.pkl", "--data", files / "train.csv", "--out", tmp_path / "m.py")
    status, out, err = palpate(*words)
    assert status == 2 and "runs whatever code it holds" in err and "it was run" not in out + err
    assert one_sentence(err) and not (tmp_path / "m.py").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("none.skops",), "there is no model"),
        (("train.csv",), "use .skops, .joblib"),
        (("model.joblib",), "say --trust"),
        (("strange.skops",), "does not know to be harmless"),
        (("text.skops",), "cannot be read as a model"),
        (("text.pkl", "--trust"), "cannot be read as a model"),
        (("hostile.pkl", "--trust"), "NoneType cannot be compiled"),
        (("network.skops", "--trust"), "MLPRegressor cannot be compiled; take HistGradientBoosting"),
        (("unfitted.skops",), "StandardScaler was never fitted"),
        (("lost.skops",), "a coefficient that is not finite"),
        (("no.skops",), "takes 3 features, without names, and {place}/train.csv has 4 columns"),
        (("model.skops", "--target", "q"), "no column 'q'; it has a, b, c, d_mm"),
        (("model.skops", "--data", "{place}/none.csv"), "there is no table"),
        (("model.skops", "--data", "{place}/text.parquet"), "cannot be read as a table"),
        (("model.skops", "--data", "{place}/holes.csv"), "holes.csv, row 2, a: 'nan' is no finite number"),
        (("model.skops", "--data", "{place}/words.csv"), "words.csv, row 2, a: 'many' is no finite number"),
        (("model.skops", "--data", "{place}/heads.csv"), "heads.csv has no rows"),
        (("model.skops", "--data", "{place}/model.joblib"), "use .csv, .parquet"),
        (("model.skops", "--out", "m.exe"), "use .py, .mpy, .c, .h"),
        (("model.skops", "--out", "m.c", "--arch", "armv6m"), "--arch is of a .mpy"),
        (("model.skops", "--out", "{place}/m.mpy", "--arch", "z80"), "no architecture is called 'z80'"),
        (("model.skops", "--key", "{place}"), "--key is of a .mpy or .palp"),
        (("model.skops", "--calibrate", "{place}/more.csv"), "--calibrate needs --target"),
        (("model.skops", "--unit", "mm", "--unit", "kPa"), "units has 2 entries for 1 outputs"),
        (("model.skops", "--target", "d2_mm", "--calibrate", "{place}/more.csv"), "has no column 'd2_mm'"),
    ],
)  # fmt: skip
def test_what_cannot_be_compiled_is_one_sentence(palpate, files, tmp_path, words, says):
    name, *more = (str(word).format(place=files) for word in words)
    given = ("compile", files / name, "--data", files / "train.csv", "--out", tmp_path / "m.py", *more)
    status, out, err = palpate(*given)
    assert says.format(place=files) in err
    assert status == 2 and one_sentence(err) and out.replace("it was run\n", "") == ""
    assert not list(tmp_path.glob("m.*"))
