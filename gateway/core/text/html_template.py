"""Templates of HTML pages. Text is escaped here for all: for HTML, and where it is not seen or turns text around."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

from gateway import __version__
from gateway.core.optional_packages import require_packages
from gateway.core.text.page_parts import Part, page_part, plot_licence, script_policy
from gateway.core.text.text import escaped, json_text

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

    def source(path: str) -> str:
        source_package, _, file = path.partition("/")
        return resources.files(source_package).joinpath(file).read_text(encoding="utf-8")

    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, finalize=visible, loader=jinja2.FunctionLoader(source)
    )
    return environment.get_template(f"{package}/{name}")


def result_page(package: str, name: str, *, scripts: Sequence[Part] = (), style: str = "", **values: object) -> str:
    """Return a page of results: a template that fills the parts of `result_page.html.j2`; deterministic.

    Args:
        package: where the template is.
        name: its file.
        scripts: what the page runs; its policy allows nothing else.
        style: style sheet of this page, after that of all.
        values: `title`, `facts`, `answer` and `steps`, and what the template needs besides.

    Raises:
        OutputError: jinja2 is missing.
    """
    require_packages("a page", "plot", "jinja2")
    from markupsafe import Markup

    sheets = [page_part("result_page.css").text, *([page_part("uPlot.min.css").text] if scripts else []), style]
    return html_template(package, name).render(
        version=__version__,
        policy=script_policy(scripts),
        style=Markup("\n".join(sheets)),
        scripts=Markup("\n".join(script.html() for script in scripts)),
        licence=Markup(plot_licence()) if scripts else "",
        **values,
    )


def script_data(document: object) -> Markup:
    """Return JSON as the content of a script element: nothing in it can end the element."""
    from markupsafe import Markup

    safe = json_text(document, compact=True).replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
    return Markup(safe)
