"""What campaigns have counted: printed, and kept in the file of `PALPATE_CAMPAIGNS` for the docs."""

from __future__ import annotations

import json
import os


def counted(line: str) -> None:
    """Print what a test has counted; `make test-long` keeps it, by the test's name."""
    print(f"\n{line}")
    if kept := os.environ.get("PALPATE_CAMPAIGNS"):
        test = os.environ["PYTEST_CURRENT_TEST"].partition(" (")[0]
        with open(kept, "a", encoding="utf-8") as file:
            file.write(json.dumps({"test": test, "counted": line}) + "\n")
