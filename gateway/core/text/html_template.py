"""Templates of HTML pages. Text is escaped here for all: for HTML, and where it is not seen or turns text around."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

from gateway.core.text.text import escaped

if TYPE_CHECKING:
    import jinja2
    from markupsafe import Markup


@cache
def html_template(package: str, name: str) -> jinja2.Template:
    """Return the template of a package; needs jinja2."""
    import jinja2
    from markupsafe import Markup

    def visible(value: object) -> object:
        if not isinstance(value, str) or isinstance(value, Markup):
            return value
        return "\n".join(map(escaped, value.split("\n")))

    source = resources.files(package).joinpath(name).read_text(encoding="utf-8")
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, finalize=visible)
    return environment.from_string(source)


def report_css() -> Markup:
    """Return the style sheet of reports, which is not escaped: it is our own file."""
    from markupsafe import Markup

    return Markup(resources.files("gateway.diagnosis.views").joinpath("closure_report.css").read_text(encoding="utf-8"))
