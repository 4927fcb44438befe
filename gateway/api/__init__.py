"""Interface for programs and notebooks; `import gateway` offers all of it."""

import logging

# A program decides what it shows of the log. Without this, Python prints warnings where nothing is configured.
logging.getLogger("gateway").addHandler(logging.NullHandler())
