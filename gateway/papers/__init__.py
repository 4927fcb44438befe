"""Figures of the papers, redrawn from the models and estimators of this project."""
