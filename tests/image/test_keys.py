"""Signing keys: no leaf is ever used twice, whatever happens to the directory."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest

from firmware_py import lms, status
from model_export import key_files, keys, lms_sign
from model_export.errors import SigningError


@pytest.fixture
def key(tmp_path, monkeypatch):
    monkeypatch.setenv("PALPATE_STATE", str(tmp_path / "state"))
    keys.generate(tmp_path / "key", height=5, width=4)
    return tmp_path / "key"


def sign(directory, message=b"message", **words):
    return keys.sign(directory, lambda leaf: message + bytes((leaf,)), **words)


def leaf_of(signed, directory):
    key = (directory / "public.key").read_bytes()
    return int.from_bytes(signed[-lms.signature_size(key) :][:4], "big")


def test_a_signature_verifies_and_leaves_are_used_in_order(key):
    public = (key / "public.key").read_bytes()
    for n in range(3):
        signed, after = sign(key)
        assert lms.verify(public, lambda at, k, s=signed: s[at : at + k], len(signed)) == status.OK
        assert leaf_of(signed, key) == n and after.used == n + 1


def test_an_exhausted_key_is_refused(key):
    for _ in range(32):
        sign(key)
    with pytest.raises(SigningError, match="exhausted"):
        sign(key)


def test_the_state_is_on_disk_before_a_signature_is_made(key, monkeypatch):
    seen = []
    real = lms_sign.sign

    def spy(secret, nodes, number, message, randomizer):
        seen.append((key_files.read_state(key / "state.json")[0], (key / "journal").read_text().count("\n")))
        return real(secret, nodes, number, message, randomizer)

    monkeypatch.setattr(lms_sign, "sign", spy)
    sign(key)
    sign(key)
    assert seen == [(1, 1), (2, 2)]


def test_every_write_of_the_state_is_synced(key, monkeypatch):
    synced = []
    real = os.fsync
    monkeypatch.setattr(
        os, "fsync", lambda handle: (synced.append(os.fstat(handle).st_mode), real(handle))[1]
    )
    sign(key)
    # journal, state and witness: the file and its directory each
    assert len(synced) >= 6


def test_a_directory_copied_back_is_refused(key, tmp_path):
    sign(key)
    shutil.copytree(key, tmp_path / "backup")
    sign(key)
    shutil.rmtree(key)
    shutil.copytree(tmp_path / "backup", key)
    with pytest.raises(SigningError, match="copied back"):
        sign(key)


def test_so_is_a_copy_beside_the_original(key, tmp_path):
    sign(key)
    shutil.copytree(key, tmp_path / "copy")
    sign(tmp_path / "copy")
    with pytest.raises(SigningError, match="copied back"):
        sign(key)


def test_so_is_a_copy_that_went_its_own_way(key, tmp_path, monkeypatch):
    """Both copies have signed once since they parted: the counts agree, the words do not."""
    sign(key)
    shutil.copytree(key, tmp_path / "copy")
    shutil.copytree(tmp_path / "state", tmp_path / "elsewhere")
    sign(key)
    with monkeypatch.context() as other:
        other.setenv("PALPATE_STATE", str(tmp_path / "elsewhere"))
        sign(tmp_path / "copy")
    with pytest.raises(SigningError, match="copied back"):
        sign(tmp_path / "copy")


@pytest.mark.parametrize("name", ["state.json", "journal"])
def test_so_is_one_of_its_files_alone(key, name):
    sign(key)
    old = (key / name).read_bytes()
    sign(key)
    sign(key)
    (key / name).write_bytes(old)
    with pytest.raises(SigningError, match="copied back"):
        sign(key)


def test_a_cut_between_journal_and_state_wastes_the_leaf(key):
    sign(key)
    before = (key / "state.json").read_bytes()
    sign(key)
    (key / "state.json").write_bytes(before)
    key_files.write_witness(
        keys.load(key, adopt=True).secret.ident, *key_files.read_state(key / "state.json")
    )
    signed, after = sign(key)
    assert leaf_of(signed, key) == 2 and after.used == 3


def test_a_journal_torn_in_its_last_line_counts_that_leaf_as_used(key):
    sign(key)
    sign(key)
    text = (key / "journal").read_text() + "2 abc"
    (key / "journal").write_text(text)
    signed, _ = sign(key)
    assert leaf_of(signed, key) == 3
    assert leaf_of(sign(key)[0], key) == 4


def test_a_key_that_signed_on_another_machine_must_be_adopted(key, tmp_path, monkeypatch):
    sign(key)
    monkeypatch.setenv("PALPATE_STATE", str(tmp_path / "other machine"))
    with pytest.raises(SigningError, match="--adopt"):
        sign(key)
    assert leaf_of(sign(key, adopt=True)[0], key) == 1
    assert leaf_of(sign(key)[0], key) == 2


@pytest.mark.parametrize("name", ["state.json", "journal", "secret.json", "public.key"])
def test_damage_is_named_in_one_sentence(key, name):
    sign(key)
    (key / name).write_bytes(b"\xff{")
    with pytest.raises(SigningError, match="damaged"):
        sign(key)


def test_a_lost_tree_is_grown_again(key):
    (key / "tree.bin").unlink()
    sign(key)


def test_a_directory_without_a_key_and_one_that_has_one(key, tmp_path):
    with pytest.raises(SigningError, match="keygen"):
        sign(tmp_path / "nowhere")
    with pytest.raises(SigningError, match="already"):
        keys.generate(key)


@pytest.mark.skipif(os.name == "nt", reason="POSIX permissions")
def test_the_secret_is_for_its_owner_only(key):
    assert (key / "secret.json").stat().st_mode & 0o077 == 0


def test_two_programs_cannot_sign_at_once(key):
    code = (
        "import sys; from model_export import key_files; from pathlib import Path\n"
        "with key_files.locked(Path(sys.argv[1])): print('held', flush=True); sys.stdin.readline()"
    )
    other = subprocess.Popen(
        [sys.executable, "-c", code, str(key)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert other.stdin is not None and other.stdout is not None
    assert other.stdout.readline() == "held\n"
    with pytest.raises(SigningError, match="another program"):
        sign(key)
    other.kill()
    other.wait()
    other.stdout.close()
    other.stdin.close()
    sign(key)
