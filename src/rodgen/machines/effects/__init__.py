"""Physical effects of a machine: the catalogue, definitions of one's own, and where each may act."""
