"""Sessions: sources, recorder, decoder, pipeline and views, put together."""
