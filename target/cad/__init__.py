"""The box for workshops: a solid to print in 3-D, inlaid tags in two colours, panels and a net to cut."""
