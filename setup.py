"""A wheel must be whole: it carries what npm installs, MicroPython/WASM and the page's font."""

from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.errors import SetupError

FROM_NPM = (
    "sim/probe/wasm/node_modules/@micropython/micropython-webassembly-pyscript/micropython.wasm",
    "host/view/fonts/node_modules/@fontsource-variable/inter/files/inter-latin-wght-normal.woff2",
)


class BuildWhole(build_py):
    def run(self) -> None:
        missing = [name for name in FROM_NPM if not (Path(__file__).parent / name).is_file()]
        if missing and not self.editable_mode:
            raise SetupError(f"{missing[0]} is not there; run `make setup` first, then `make wheel`")
        super().run()


setup(cmdclass={"build_py": BuildWhole})
