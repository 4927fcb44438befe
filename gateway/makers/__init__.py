"""Check of a firmware, and code for it."""
