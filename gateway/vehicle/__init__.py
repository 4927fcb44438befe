"""Signals of the vehicle beside the wheels."""
