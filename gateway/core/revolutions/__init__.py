"""Signal analysis on arrays: from samples to revolutions, contact edges and orders."""
