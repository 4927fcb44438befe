"""Figures of the two papers, redrawn from the models and estimators of this project."""
