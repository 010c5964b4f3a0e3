"""Run every benchmark, or those whose names are given: python -m tests.benchmarks [tissue link ...]."""

import importlib
import sys
from pathlib import Path


def main(names: list[str]) -> int:
    have = sorted(path.stem for path in Path(__file__).parent.glob("bench_*.py"))
    wanted = [f"bench_{name.removeprefix('bench_')}" for name in names] or have
    unknown = [name for name in wanted if name not in have]
    if unknown:
        print(f"there is no benchmark {unknown[0]}; there are {', '.join(have)}", file=sys.stderr)
        return 2
    for name in wanted:
        print(f"\n=== {name.removeprefix('bench_')}", flush=True)
        importlib.import_module(f"tests.benchmarks.{name}").main()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
