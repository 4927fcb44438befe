"""The page as one file of HTML: markup, style and scripts joined, nothing from the network."""

from base64 import b64encode
from functools import lru_cache
from hashlib import sha256
from importlib import resources
from typing import Final, NamedTuple

_PARTS: Final = {
    "<!-- STYLE -->": ("style", "uPlot.min.css"),
    "<!-- OWN STYLE -->": ("style", "page.css"),
    "<!-- PLOTS -->": ("script", "uPlot.iife.min.js"),
    "<!-- SCRIPT -->": ("script", "page.js"),
}


class PageFile(NamedTuple):
    """The page, and the policy that allows its own scripts and this server only."""

    html: bytes
    policy: str


@lru_cache(maxsize=1)
def page_file() -> PageFile:
    """Return the page."""
    folder = resources.files(__package__)
    html = folder.joinpath("page.html").read_text(encoding="utf-8")
    html = html.replace("LICENCE OF THE PLOTS", folder.joinpath("uPlot.LICENSE").read_text(encoding="utf-8"))
    hashes: list[str] = []
    for placeholder, (element, name) in _PARTS.items():
        text = folder.joinpath(name).read_text(encoding="utf-8")
        if element == "script":
            hashes.append(f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'")
        html = html.replace(placeholder, f"<{element}>{text}</{element}>")
    policy = (
        f"default-src 'none'; script-src {' '.join(hashes)}; style-src 'unsafe-inline'; connect-src 'self'; "
        "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return PageFile(html.encode(), policy)
