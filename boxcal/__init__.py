"""Calibrate every robot's camera, wheels and camera extrinsics from one AprilTag box and the robot's log."""
