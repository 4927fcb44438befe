"""Simulated Bluetooth LE hubs on a private D-Bus."""
