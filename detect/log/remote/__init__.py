"""Recordings and results behind URLs, through fsspec: read in place, written whole."""
