"""Planning of drives: where the next stops are most informative, and which whole drive is enough."""
