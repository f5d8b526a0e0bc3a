"""What explains what noise does not: one explanation a file, one catalogue, one chooser."""
