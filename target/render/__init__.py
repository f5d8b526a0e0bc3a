"""A renderer of the box with exact edges: what a camera sees from any pose."""
