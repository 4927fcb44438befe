"""Generator of the documentation site: `python -m tools.docs_site build/docs`, run by `make docs`.

Pages in docs/ are written by hand. References are generated here from the code that they describe.
"""
