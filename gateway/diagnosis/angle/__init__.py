"""Signal locked to the wheel's angle: likelihood, fit of a set of effects, its evidence, residual and numbers."""
