"""Read-only views of snapshots and results: console, plain lines, tables."""
