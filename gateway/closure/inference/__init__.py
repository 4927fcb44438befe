"""Inference: fit, selection and validation of effects."""
