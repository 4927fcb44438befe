"""Stands in for hardware: physics to samples to frames to bytes."""
