"""Campaign data: revolutions grouped by conditions, with their scatter."""
