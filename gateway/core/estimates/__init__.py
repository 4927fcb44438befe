"""Estimators of tire quantities from single and averaged revolutions."""
