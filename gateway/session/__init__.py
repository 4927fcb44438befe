"""The composition root: sources, recorder, decoder, pipeline and views, put together."""
