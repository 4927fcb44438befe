"""Choice of a sensor before it is bought."""
