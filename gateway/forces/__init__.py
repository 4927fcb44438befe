"""Forces, slip and ply steer, and the calibrations of a tire."""
