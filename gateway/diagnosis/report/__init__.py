"""Results of a diagnosis: findings, held-out errors, contributions of effects, deciding recordings, curves."""
