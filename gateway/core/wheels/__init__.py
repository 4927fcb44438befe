"""The synchronous core: frames in, revolutions and estimates out; no I/O, no clock."""
