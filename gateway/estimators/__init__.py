"""Estimators: one interface, one registry."""
