"""Probabilities of sets of effects and errors of their parameters, whatever part of the signal they are of."""
