"""The parameters that every calibration reports: their order, and what stands where."""

ORDER = ("fu", "fv", "cu", "cv", "kr", "rR", "rL", "b", "rx", "ry", "rz", "tx", "ty", "tz")
"""Camera (px), wheels (m), rotation (rad) and translation (m) of the camera extrinsics."""
CAMERA, WHEELS, MOUNTING = slice(0, 5), slice(5, 8), slice(8, 14)
FOCAL, CENTRE, DISTORTION = slice(0, 2), slice(2, 4), slice(4, 5)
ROTATION, TRANSLATION = slice(8, 11), slice(11, 14)
COUNT = len(ORDER)
