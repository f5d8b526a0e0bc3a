"""The parameters of a tag in the image, by their place in theta."""

PARAMETERS = 14
"""h (8), offset o, gain g, slopes s_x and s_y, log sigma, excess kurtosis of the blur."""
BLACK, CONTRAST, GRADIENT_X, GRADIENT_Y, LOG_PSF, KURTOSIS = range(8, 14)
