"""Corners of tags at the noise limit: every tag's known pattern is aligned with the image, pixel by pixel."""
