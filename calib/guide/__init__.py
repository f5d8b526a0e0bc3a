"""A guide at the robot's side while it drives: what it sees, which stop is next, when it is enough."""
