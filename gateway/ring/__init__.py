"""The rolling ring, and the fit of its exact equilibrium."""
