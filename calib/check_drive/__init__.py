"""A calibrated robot's check drive against what its calibration predicts: by the box, a tape or a mark."""
