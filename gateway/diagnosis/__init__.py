"""Physical effects that the model of a wheel lacks."""
