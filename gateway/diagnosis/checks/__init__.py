"""Checks of what is stated of recordings: tire, load, contact, rolling direction, speeds, reference model."""
