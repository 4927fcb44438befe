"""Screen of a session on the terminal."""
