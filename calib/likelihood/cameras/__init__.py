"""Several cameras of one robot: lens, extrinsics and noise of each; wheels, stops, floor and box of all."""
