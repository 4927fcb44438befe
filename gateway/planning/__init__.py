"""What a sensor will be able to measure on a tire, before it is bought."""
