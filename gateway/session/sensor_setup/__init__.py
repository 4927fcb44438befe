"""Which sensor is on which wheel, and how far each has rolled: the measurements of `treadlink setup`."""
