"""What the packages take, as `palpate doctor --sizes` says it."""

from __future__ import annotations

from palpate.sizes import sizes


def test_every_package_that_is_needed_is_listed_once_with_what_it_takes():
    found = {size.name: size for size in sizes()}
    assert len(found) == len(sizes())
    assert {"numpy", "numba", "llvmlite", "pyarrow", "scipy"} <= found.keys()
    assert found["llvmlite"].MB > 50 and found["llvmlite"].asked_by == "palpate"
    assert found["fonttools"].asked_by == "matplotlib"
    assert found["h5py"].asked_by == "palpate[hdf5]" and found["mypy"].asked_by == "palpate[lint]"
    assert "palpate" not in found
