"""Write every page of the site, for the site generator to render: `python -m tools.docs_site FOLDER`.

`--run-notebooks` adds the outputs of the notebooks to their pages.
"""

import argparse
from pathlib import Path

from tools.docs_site.staging import stage

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--run-notebooks", action="store_true")
    options = parser.parse_args()
    stage(options.folder, run_notebooks=options.run_notebooks)
