"""Pages for people on this machine or beside the robot: a server with bounds, and state that is pushed to it."""
