"""Page of `treadlink estimate --html`, as an output of the command."""

from typing import Final

from gateway.core.cli.estimate_outputs import AddedOutput
from gateway.core.cli.path_option import path_option

PAGE: Final = AddedOutput(
    factory="gateway.compare.views.drive_page:open_pages",
    parameter="html_path",
    option=path_option(
        "--html",
        "html_path",
        help="Write a page with wheels, means and quantities over time to this file; needs treadlink[plot].",
    ),
)
