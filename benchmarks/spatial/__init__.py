"""Speed of the functions for spatial mechanisms, compared with hand-written NumPy and hardware limits."""
