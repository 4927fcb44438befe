"""Signal that is not locked to the angle: densities, their fit, sets of effects and what is unexplained."""
