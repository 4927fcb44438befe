"""Blind cases of the closed loop: a ring, sensors and causes written without the closure's equations."""
