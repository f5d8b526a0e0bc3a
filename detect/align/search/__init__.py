"""Where tags are: seeds, and from a few tags of a rigid box all of them."""
