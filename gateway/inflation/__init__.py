"""Pressure warning by the rules for tire pressure monitoring systems, against the placard of the vehicle."""
