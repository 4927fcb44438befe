"""The page as one file of HTML: markup, style and scripts joined, nothing from the network."""

from functools import lru_cache
from importlib import resources
from typing import NamedTuple

from gateway.core.text.page_parts import page_part, plot_licence, script_policy


class PageFile(NamedTuple):
    """The page, and the policy that allows its own scripts and this server only."""

    html: bytes
    policy: str


@lru_cache(maxsize=1)
def page_file() -> PageFile:
    """Return the page."""
    html = resources.files(__package__).joinpath("page.html").read_text(encoding="utf-8")
    html = html.replace("LICENCE OF THE PLOTS", plot_licence())
    parts = {
        "<!-- STYLE -->": page_part("uPlot.min.css"),
        "<!-- OWN STYLE -->": page_part("page.css", __package__),
        "<!-- PLOTS -->": page_part("uPlot.iife.min.js"),
        "<!-- PICTURES -->": page_part("pictures.js"),
        "<!-- SCRIPT -->": page_part("page.js", __package__),
    }
    for placeholder, part in parts.items():
        html = html.replace(placeholder, part.html())
    policy = (
        f"{script_policy(parts.values())}; connect-src 'self'; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'"
    )
    return PageFile(html.encode(), policy)
