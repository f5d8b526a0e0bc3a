"""Several cameras of one robot: lens, mounting and noise of each; wheels, stops, floor and box of all."""
