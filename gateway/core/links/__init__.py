"""Byte sources: serial ports, TCP and Bluetooth LE, behind one registry of URIs."""
