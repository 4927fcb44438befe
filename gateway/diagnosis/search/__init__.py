"""Search of the sets of effects locked to the angle, and the posterior over them."""
