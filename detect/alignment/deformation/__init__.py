"""Deformation of the paper within tags: its model on their edges, and its prediction at their corners."""
