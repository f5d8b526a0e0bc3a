"""Explanations of misfit beyond noise: one explanation a file, one catalogue, one chooser."""
