"""Looking into recordings in a browser: samples at any scale, revolutions, orders, quantities over time."""
