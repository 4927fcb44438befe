"""Work on finished recordings."""
