"""Frames on the move of several cameras: all on one path of the wheels, each camera with a clock of its own."""
