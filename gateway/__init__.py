"""Treadlink: the gateway between intelligent tires and the engineer's laptop."""

__version__ = "0.1.0"
