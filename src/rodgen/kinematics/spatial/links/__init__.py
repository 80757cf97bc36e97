"""Links and joints: what a mechanism is made of, its forward analysis, its mobility, and its table."""
