"""Closing the loop: why does the model not fit this tire?"""
