"""Paper: sheets, tiles, the fold-up net, the guide to building the box and its record card."""
