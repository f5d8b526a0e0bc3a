"""Tags of one image, and the frames of a stop averaged."""
