"""A drive as one HTML page: wheels at a glance, means, and quantities over time."""
