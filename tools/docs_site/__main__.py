"""`python -m tools.docs_site FOLDER`: write every page of the site, for the site generator to render."""

from __future__ import annotations

import sys
from pathlib import Path

from tools.docs_site.staging import stage

if __name__ == "__main__":
    stage(Path(sys.argv[1]))
