"""Rotations, rigid transforms and differential-drive kinematics."""
