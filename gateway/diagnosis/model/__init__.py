"""Closure model: baseline models of the belt with effects on top."""
