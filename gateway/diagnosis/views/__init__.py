"""The report of a diagnosis: HTML, JSON and terminal."""
