"""Trends of tires and sensors over many recordings: regression, steps, outliers, with errors that hold."""
