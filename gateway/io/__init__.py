"""Byte sources: serial, TCP, replay, simulator, behind one registry of URIs."""
