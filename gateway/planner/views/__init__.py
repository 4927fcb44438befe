"""Plans of sensors and of recordings: lines, JSON and a figure."""
