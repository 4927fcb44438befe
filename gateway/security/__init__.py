"""Verification of frames: keys, signatures, freshness, and the sensors that belong to a vehicle."""
