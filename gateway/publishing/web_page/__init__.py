"""The page that `--web` serves: its state as JSON, and its one file of HTML."""
