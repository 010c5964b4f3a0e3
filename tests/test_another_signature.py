"""Another signature scheme is a module on either side and the line that names it: architecture.md says so."""

import json
import shutil

from firmware_py import status
from tests.test_another_field import replaced
from tests.test_another_output import ROOT, copied, run

VERIFYING = '''
"""A key that whoever has it could sign with: short, and of no use but here."""
import hashlib

from firmware_py import status


def available():
    return True


def signature_size(key):
    return 32 if key[:3] == b"TOY" and len(key) == 19 else 0


def verify(key, read, size, context):
    body = size - signature_size(key)
    good = hashlib.sha256(key + context + read(0, body)).digest()
    return status.OK if read(body, 32) == good else status.BAD_SIGNATURE
'''
SIGNING = """
import hashlib
import secrets
from dataclasses import dataclass


@dataclass(frozen=True)
class Secret:
    seed: bytes

    @classmethod
    def draw(cls):
        return cls(secrets.token_bytes(16))

    @property
    def content(self):
        return {"seed": self.seed.hex()}

    @classmethod
    def read(cls, content, public):
        return cls(bytes.fromhex(content["seed"]))


def public_key(secret):
    return b"TOY" + secret.seed


def sign(secret, public, message, context):
    return hashlib.sha256(public + context + message).digest()
"""


def test_another_scheme_from_the_key_to_the_slot(tmp_path):
    home = copied(tmp_path / "home")
    shutil.copytree(ROOT / "tests" / "model_export", home / "tests" / "model_export")
    signing = home / "palpate" / "model_export" / "signing"
    (home / "firmware_py" / "toy.py").write_text(VERIFYING)
    (signing / "toy_sign.py").write_text(SIGNING)
    replaced(home / "firmware_py" / "signature.py", r"import slh_dsa as scheme$", "import toy as scheme")
    replaced(signing / "keys.py", r"import slh_sign as scheme$", "import toy_sign as scheme")
    said = json.loads(run(home, "tests.another_signature", str(tmp_path)).splitlines()[-1])
    assert (said["key"], said["signature"]) == (19, 32)
    bad, ok = status.BAD_SIGNATURE, status.OK
    assert said["flashed"] == [bad, ok, bad, ok, ok]
