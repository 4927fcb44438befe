"""Which frames are taken for true: keys, signatures, freshness, and the sensors that belong to a vehicle."""
