"""Set-up's `.ci/strip`: libraries lose their tables and still load; all else stays as it is."""

import ctypes
import subprocess
import sys
from pathlib import Path

STRIP = Path(__file__).parents[1] / ".ci" / "strip"
FUNCTIONS = 2000


def strip(folder):
    subprocess.run([sys.executable, STRIP, folder], check=True)


def test_a_library_without_its_tables_loads_and_is_smaller(tmp_path):
    source, library = tmp_path / "many.c", tmp_path / "many.so"
    source.write_text("".join(f"int number_{n}(void) {{ return {n}; }}\n" for n in range(FUNCTIONS)))
    subprocess.run(["gcc", "-g", "-shared", "-fPIC", "-o", library, source], check=True)
    whole = library.stat()
    strip(tmp_path)
    assert library.stat().st_size < 0.8 * whole.st_size
    assert library.stat().st_mode == whole.st_mode
    assert ctypes.CDLL(str(library)).number_1234() == 1234


def test_a_program_without_its_tables_runs(tmp_path):
    source, program = tmp_path / "many.c", tmp_path / "many"
    functions = "".join(f"int number_{n}(void) {{ return {n}; }}\n" for n in range(FUNCTIONS))
    source.write_text(functions + "int main(void) { return number_7(); }\n")
    subprocess.run(["gcc", "-g", "-o", program, source], check=True)
    whole = program.stat().st_size
    strip(tmp_path)
    assert program.stat().st_size < whole
    assert subprocess.run([program]).returncode == 7


def test_what_is_not_such_a_file_stays_as_it_is(tmp_path):
    plain = bytes(range(256)) * 2000
    cut = b"\x7fELF\x02\x01" + bytes(10) + b"\x03\x00" + bytes([255] * 46) + plain  # headers beyond its end
    for name, data in (("plain", plain), ("cut", cut)):
        (tmp_path / name).write_bytes(data)
    strip(tmp_path)
    assert (tmp_path / "plain").read_bytes() == plain
    assert (tmp_path / "cut").read_bytes() == cut
