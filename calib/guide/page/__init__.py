"""The local page that shows the guide, and its server."""
