"""Files are whole or not there, and on disk before they take their place."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from palpate.cli import cli
from palpate.errors import PalpateError
from palpate.files import check_writable, whole_file
from palpate.model_export.signing import keys
from tests.host.probes import connect
from tests.model_export import small_key, synthetic


def test_the_content_is_synced_before_the_rename_and_the_name_after(tmp_path, monkeypatch):
    """The rename came first: after a loss of power the name could stand for an empty file."""
    done = []
    fsync, replace = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda h: (done.append("directory" if _is_dir(h) else "file"), fsync(h)))
    monkeypatch.setattr(os, "replace", lambda a, b: (done.append("rename"), replace(a, b)))
    with whole_file(tmp_path / "x.txt") as path:
        path.write_text("content")
    assert done == ["file", "rename", "directory"]


def _is_dir(handle):
    import stat

    return stat.S_ISDIR(os.fstat(handle).st_mode)


def test_what_can_be_written_leaves_nothing_behind(tmp_path):
    check_writable(tmp_path / "new" / "x.palp")
    assert list((tmp_path / "new").iterdir()) == []
    with pytest.raises(PalpateError, match="device or a directory"):
        check_writable(tmp_path)


def test_export_finds_an_unwritable_out_before_it_signs(tmp_path):
    """It signed, which with the keys of old spent one of their signatures, and then could not write."""
    keys.generate(tmp_path / "key", small_key.secret())
    synthetic.model("thesis").save(tmp_path / "model.json")
    (tmp_path / "file").write_text("")
    words = ["export", str(tmp_path / "model.json"), "--key", str(tmp_path / "key")]
    done = CliRunner().invoke(cli, [*words, "--out", str(tmp_path / "file" / "model.palp")])
    assert done.exit_code != 0
    assert keys.load(tmp_path / "key").counter == 0


@pytest.mark.parametrize("runtime", ["cpython", "micropython"])
def test_a_store_named_relatively_is_the_directory_that_was_meant(emulated, tmp_path, monkeypatch, runtime):
    """Anywhere but in the repository's root: "the probe's store could not be read or written"."""
    monkeypatch.chdir(tmp_path)
    with connect(emulated(runtime, store=Path("flash"))) as probe:
        probe.set_setting("frame_rate", 25_000)
    assert any((tmp_path / "flash").glob("set*"))


FULL = """
import resource, sys
from palpate import models
from palpate.learn.fit import Fit
fit = Fit("field", models.load(models.FIELD), None)
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
fit.save(sys.argv[1])
"""


def test_a_full_disk_names_the_model_that_was_not_written_and_leaves_nothing(tmp_path):
    """It named a file that nobody knew, ".model.1211.json"."""
    out = tmp_path / "model.json"
    run = subprocess.run([sys.executable, "-c", FULL, out], capture_output=True, text=True, check=False)
    assert f"the disk is full: {out} was not written" in run.stderr
    assert list(tmp_path.iterdir()) == []
