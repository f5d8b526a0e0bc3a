"""One change of the store a file, by number."""
