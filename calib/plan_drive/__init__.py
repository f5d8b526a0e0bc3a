"""The command plan-drive: robots to plan for, and the files of a plan."""
