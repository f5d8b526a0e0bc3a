"""Simulated robots that drive around the box and leave ordinary ROS 2 logs, with the truth beside them."""
