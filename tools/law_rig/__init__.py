"""Rig for laws: causes made by a tire that rolls in time, not by the library's equations."""
