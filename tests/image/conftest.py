"""Models, keys and signed images, made once for all the tests here."""

from __future__ import annotations

import pytest

from model_export import compiler, keys
from model_export.exporter import export
from tests.image import synthetic


@pytest.fixture(autouse=True)
def own_state_directory(tmp_path_factory, monkeypatch):
    """Keep the witnesses of signing keys out of the user's own state directory."""
    monkeypatch.setenv("PALPATE_STATE", str(tmp_path_factory.getbasetemp() / "state"))


@pytest.fixture(scope="session")
def field():
    return synthetic.model("field")


@pytest.fixture(scope="session")
def thesis():
    return synthetic.model("thesis")


@pytest.fixture(scope="session")
def field_tables(field):
    return compiler.compile_model(field)


@pytest.fixture(scope="session")
def thesis_tables(thesis):
    return compiler.compile_model(thesis)


@pytest.fixture(scope="session")
def key_dir(tmp_path_factory):
    """A key of 32 signatures, 4 bits a digit: quick to make and to verify."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PALPATE_STATE", str(tmp_path_factory.getbasetemp() / "state"))
        directory = tmp_path_factory.mktemp("key") / "key"
        keys.generate(directory, height=5, width=4)
    return directory


@pytest.fixture(scope="session")
def public_key(key_dir):
    return (key_dir / "public.key").read_bytes()


@pytest.fixture(scope="session")
def signed(thesis, key_dir, tmp_path_factory):
    """Images of three thesis models by counter 1, 2, 3; under -1 the first as a rollback of these."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PALPATE_STATE", str(tmp_path_factory.getbasetemp() / "state"))
        models = [synthetic.model("thesis", seed=seed) for seed in (1, 2, 3)]
        images = {n + 1: export(m, key_dir, counter=n + 1)[0] for n, m in enumerate(models)}
        images[-1] = export(models[0], key_dir, counter=1, rollback=True)[0]
    return images
