"""Models, keys and signed images, made once for all the tests here."""

from __future__ import annotations

import pytest

from palpate.model_export.exporter import export
from palpate.model_export.integers import compiler
from palpate.model_export.signing import keys
from tests.model_export import small_key, synthetic


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
    """A key of the tests' own small set: quick to sign with and to verify."""
    directory = tmp_path_factory.mktemp("key") / "key"
    keys.generate(directory, small_key.secret())
    return directory


@pytest.fixture(scope="session")
def public_key(key_dir):
    return (key_dir / "public.key").read_bytes()


@pytest.fixture(scope="session")
def signed(key_dir):
    """Images of three thesis models by counter 1, 2, 3; under -1 the first as a rollback of these."""
    models = [synthetic.model("thesis", seed=seed) for seed in (1, 2, 3)]
    images = {n + 1: export(m, key_dir, counter=n + 1)[0] for n, m in enumerate(models)}
    images[-1] = export(models[0], key_dir, counter=1, rollback=True)[0]
    return images
