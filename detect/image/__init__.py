"""Images before detection: bit depth, Bayer mosaics, gray levels, response curves; and annotated images after."""
