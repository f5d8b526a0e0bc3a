"""One robot's calibration in three parts: its logs read, its drives solved for, its results written."""
