"""Speed of the Tricept's functions, compared with hand-written NumPy."""
