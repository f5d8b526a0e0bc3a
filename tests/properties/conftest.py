"""Property tests draw the same few examples in every run, so that a failure is one of the code and not of chance."""

from hypothesis import settings

settings.register_profile("properties", derandomize=True, max_examples=40, deadline=None, database=None)
settings.load_profile("properties")
