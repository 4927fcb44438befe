"""Comparison of estimates with the references in a recording, as lines of `treadlink estimate`."""

from typing import Final

from gateway.core.cli.estimate_outputs import AddedOutput

REFERENCES: Final = AddedOutput(factory="gateway.importing.reference_check:open_references")
