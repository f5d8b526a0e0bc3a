"""The command check-log: what is wrong with a recording, while the robot is still on the floor."""
