"""Signing keys: a copy, two homes, a restored home and two signers at once give nothing away."""

from __future__ import annotations

import os
import re
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_py import signature, status
from palpate.model_export.errors import SigningError
from palpate.model_export.signing import keys
from palpate.model_export.signing.keys import SUCCESSION
from tests.model_export import small_key

ROOT = Path(__file__).parent.parent.parent


@pytest.fixture
def key(tmp_path):
    keys.generate(tmp_path / "key", small_key.secret())
    return tmp_path / "key"


def sign(directory, message=b"message", **words):
    return keys.sign(directory, lambda counter: message + counter.to_bytes(4, "little"), **words)


def good(key, signed, *context):
    return signature.verify(key, lambda at, n: signed[at : at + n], len(signed), *context) == status.OK


def test_two_homes_with_one_key_give_an_adversary_nothing_to_forge_with(key, tmp_path):
    """LMS: two images signed with one leaf, and a third was forged from them in 46 s.

    The same message gets the same signature everywhere; nothing is counted, so nothing is used twice.
    """
    shutil.copytree(key, tmp_path / "copy")
    public = (key / "public.key").read_bytes()
    for k in range(20):
        here, there = (sign(home, b"%d" % k, counter=5)[0] for home in (key, tmp_path / "copy"))
        assert here == there and good(public, here)
    # the state of a home is no part of a signature: with it put back, the same is signed again
    assert sign(key, b"1", counter=5)[0] == sign(tmp_path / "copy", b"1", counter=5)[0]


def test_the_one_time_keys_above_sign_only_what_never_changes(key):
    """A one-time key of a tree signs one few-time key or one tree's root, whatever the message."""
    import hashlib

    signed_by: dict[bytes, set[bytes]] = {}
    public = (key / "public.key").read_bytes()
    for k in range(300):  # 256 few-time keys in this small set: many meet
        signed, _ = sign(key, b"%d" % k, counter=k)
        end = signed[-signature.size(public) :]
        upper = end[16 * (1 + 8 * 5) + 16 * 39 :]  # the top layer's one-time signature and path
        path = upper[16 * 35 :]
        signed_by.setdefault(hashlib.sha256(path).digest(), set()).add(upper[: 16 * 35])
    assert len(signed_by) <= 16 and all(len(what) == 1 for what in signed_by.values())


def test_a_home_put_back_from_a_backup_signs_on(key, tmp_path):
    first = sign(key)[1]
    shutil.copytree(key, tmp_path / "backup")
    for _ in range(3):
        last = sign(key)[1]
    assert last.counter > first.counter
    shutil.rmtree(key)
    shutil.copytree(tmp_path / "backup", key)
    signed, _ = sign(key)
    assert good((key / "public.key").read_bytes(), signed)


def test_programs_that_sign_at_once_all_sign_rightly(key):
    """Of two copies 15 of 25 races used a leaf twice: locks went by directory. Now nothing is raced for."""
    code = (
        "import sys; from tests.model_export import small_key\n"
        "from palpate.model_export.signing import keys\n"
        "signed, _ = keys.sign(sys.argv[1], lambda c: b'x%d' % c); sys.stdout.buffer.write(signed)"
    )
    others = [
        subprocess.Popen([sys.executable, "-c", code, str(key)], stdout=subprocess.PIPE) for _ in range(4)
    ]
    public = (key / "public.key").read_bytes()
    assert all(good(public, other.communicate()[0]) for other in others)


def test_counters_rise_by_the_clock_whichever_home_gives_them(key, tmp_path, monkeypatch):
    shutil.copytree(key, tmp_path / "copy")
    monkeypatch.setenv("SOURCE_DATE_EPOCH", str(keys.EPOCH_S + 60 * 1000))
    assert [sign(key)[1].counter for _ in range(3)] == [1000, 1001, 1002]
    monkeypatch.setenv("SOURCE_DATE_EPOCH", str(keys.EPOCH_S + 60 * 2000))
    assert sign(tmp_path / "copy")[1].counter == 2000


def test_a_directory_that_cannot_be_written_signs_all_the_same(key, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(keys.files, "write", full)
    assert good((key / "public.key").read_bytes(), sign(key)[0])


def test_the_page_of_files_lists_what_a_key_directory_holds(tmp_path):
    """It still had the files of the old, counting key, and said that a copy is refused."""
    page = ROOT / "docs/reference/files.md"
    section = page.read_text(encoding="utf-8").partition("## Key directory")[2].partition("\n## ")[0]
    listed = set(re.findall(r"^\| `([\w.]+)`", section, flags=re.M))
    old, new = tmp_path / "old", tmp_path / "new"
    keys.generate(old, small_key.secret(1))
    public = keys.generate(new, small_key.secret(2))
    (new / SUCCESSION).write_bytes(keys.succeed(old, public))
    sign(new)
    assert {path.name for path in new.iterdir()} == listed


def test_a_new_key_is_handed_over_by_the_old_one(key, tmp_path):
    new = keys.generate(tmp_path / "new", small_key.secret(1))
    succession = keys.succeed(key, new)
    old = (key / "public.key").read_bytes()
    assert good(old, succession, signature.SUCCESSOR)
    assert not good(old, succession)  # it is no model
    assert new in succession


@pytest.mark.parametrize("name", ["secret.json", "public.key"])
@pytest.mark.parametrize("content", [b"\xff{", b"", b"[" * 100000, b'{"format": 3}'])
def test_damage_is_named_in_one_sentence(key, name, content):
    (key / name).write_bytes(content)
    with pytest.raises(SigningError, match="damaged"):
        sign(key)


@pytest.mark.parametrize("content", [b"\xff{", b'{"last": -1}', b'{"last": "x"}', b"[]"])
def test_a_damaged_counter_is_begun_again_by_the_clock(key, content):
    (key / "counter.json").write_bytes(content)
    assert sign(key)[1].counter > 1_000_000


def test_a_key_whose_seeds_were_changed_never_gives_a_signature_away(key):
    text = (key / "secret.json").read_text()
    at = text.index('"seeds": "') + 10
    (key / "secret.json").write_text(text[:at] + ("0" if text[at] != "0" else "1") + text[at + 1 :])
    with pytest.raises(SigningError, match="damaged"):
        sign(key)


def test_a_key_of_the_old_kind_is_refused(key):
    (key / "secret.json").write_text('{"format": "palpate-signing-key", "version": 1}')
    with pytest.raises(SigningError, match="LMS"):
        sign(key)


def test_a_directory_without_a_key_and_one_that_has_one(key, tmp_path):
    with pytest.raises(SigningError, match="keygen"):
        sign(tmp_path / "nowhere")
    with pytest.raises(SigningError, match="already"):
        keys.generate(key)


@pytest.mark.skipif(os.name == "nt", reason="POSIX permissions")
def test_the_secret_is_for_its_owner_only(key):
    assert stat.S_IMODE((key / "secret.json").stat().st_mode) & 0o077 == 0


YEAR_2106 = "4291747200"


def test_a_clock_that_runs_ahead_signs_nothing_unless_it_is_said_to_be_right(key, tmp_path, monkeypatch):
    """One export under a clock of 2106 locked the key's other homes out for ever."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", YEAR_2106)
    with pytest.raises(SigningError, match=r"the clock says 2106-01-01 .* --force"):
        sign(key)
    with pytest.raises(SigningError, match="--force"):
        keys.succeed(key, (key / "public.key").read_bytes())
    assert not (key / "counter.json").exists()
    assert sign(key, counter=7)[1].counter == 7  # it was told: the clock is not asked
    assert sign(key, force=True)[1].counter > 43_000_000
    monkeypatch.delenv("SOURCE_DATE_EPOCH")
    assert sign(key)[1].counter > 43_000_000  # this home goes on from there


def test_a_day_or_a_later_model_or_export_is_no_reason(key, monkeypatch):
    made = (key / "secret.json").stat().st_mtime
    monkeypatch.setenv("SOURCE_DATE_EPOCH", str(made + keys.AHEAD_S - 60))
    sign(key)  # from here on this was seen
    monkeypatch.setenv("SOURCE_DATE_EPOCH", str(made + 2 * keys.AHEAD_S - 200))
    sign(key)
    monkeypatch.setenv("SOURCE_DATE_EPOCH", str(made + 40 * keys.AHEAD_S))
    with pytest.raises(SigningError, match="--force"):
        sign(key, seen_s=made + 38 * keys.AHEAD_S)
    sign(key, seen_s=made + 39.5 * keys.AHEAD_S)


@pytest.mark.parametrize("word", ["nan", "inf", "-inf", "1e308", "tomorrow"])
def test_a_moment_that_is_none_is_one_sentence(key, monkeypatch, word):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", word)
    with pytest.raises(SigningError, match="SOURCE_DATE_EPOCH must be a number of seconds"):
        sign(key)


def test_of_two_that_make_a_key_in_one_place_one_is_told_that_it_is_taken(tmp_path):
    """Both said "made", and the one who had copied his public key had another's."""
    code = (
        "import sys; from tests.model_export import small_key\n"
        "from palpate.model_export.signing import keys, key_files\n"
        "write = key_files.write\n"
        "def slow(*words):\n"
        "    import time; time.sleep(0.3); write(*words)\n"
        "key_files.write = slow\n"
        "sys.stdout.buffer.write(keys.generate(sys.argv[1], small_key.secret(int(sys.argv[2]))))"
    )
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    makers = [subprocess.Popen([sys.executable, "-c", code, str(tmp_path), str(k)], **pipes) for k in (1, 2)]
    said = [maker.communicate() for maker in makers]
    made = [out for out, _ in said if out]
    assert made == [(tmp_path / "public.key").read_bytes()]
    assert sum(b"already holds a signing key" in err for _, err in said) == 1
    assert keys.load(tmp_path).public == made[0]


@pytest.mark.parametrize("broken", ["write", "fsync", "replace"])
def test_a_full_disk_leaves_nothing_of_a_key(tmp_path, monkeypatch, broken):
    """`.public.key.PID` stayed in the directory."""

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(keys.files.os, broken, full)
    if broken == "write":
        monkeypatch.setattr(keys.files.os, "fdopen", lambda handle, _mode: Full(handle))
    with pytest.raises(SigningError, match="No space left"):
        keys.generate(tmp_path / "key", small_key.secret())
    assert list((tmp_path / "key").iterdir()) == []


class Full:
    def __init__(self, handle):
        self.handle = handle

    def __enter__(self):
        return self

    def __exit__(self, *_):
        os.close(self.handle)

    def write(self, _data):
        raise OSError(28, "No space left on device")


def test_a_key_made_to_succeed_another_has_its_word_or_is_none(key, tmp_path, monkeypatch):
    """Killed between the two, a key without its succession stood in the way of the next try."""
    write = keys.files.write

    def killed(path, *words):
        if path.name == "secret.json":
            raise KeyboardInterrupt
        write(path, *words)

    monkeypatch.setattr(keys.files, "write", killed)
    with pytest.raises(KeyboardInterrupt):
        keys.generate(tmp_path / "new", small_key.secret(3), succeeds=key)
    monkeypatch.setattr(keys.files, "write", write)
    public = keys.generate(tmp_path / "new", small_key.secret(4), succeeds=key)
    assert public in (tmp_path / "new" / SUCCESSION).read_bytes()
