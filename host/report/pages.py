"""Pages of one kind: a template that extends `base.html`, with the report's style sheet inside."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Any

from palpate.files import whole_file
from palpate.report import style


def render(package: str, name: str, **values: Any) -> str:
    """The page that a template makes of `values`.

    Parameters
    ----------
    package, name : str
        Where the template lies: an imported package's name, and the file's.
    """
    import jinja2
    import markupsafe

    here = files("palpate.report")
    sources = {
        "base.html": (here / "base.html").read_text("utf-8"),
        name: (files(package) / name).read_text("utf-8"),
    }
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, loader=jinja2.DictLoader(sources)
    )
    environment.filters["powers"] = lambda text: markupsafe.Markup(
        style.powers_html(str(markupsafe.escape(text)))
    )
    css = (here / "report.css").read_text("utf-8")
    return environment.get_template(name).render(css=css, **values)


def written(directory: Path, text: str) -> Path:
    """Write a page as its directory's `index.html`; where that is."""
    page = directory / "index.html"
    with whole_file(page) as part:
        part.write_text(text, encoding="utf-8")
    return page
