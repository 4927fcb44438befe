"""Live outputs of a session: JSON lines, MQTT, Foxglove and CAN."""
