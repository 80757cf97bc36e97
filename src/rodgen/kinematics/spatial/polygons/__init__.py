"""Spherical polygons: the X-Y-Z notation, the equations, linkages, and the polygon of a spatial mechanism."""
