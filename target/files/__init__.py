"""Files of the target: the landmark table ``target.json``, and writing any result atomically."""
