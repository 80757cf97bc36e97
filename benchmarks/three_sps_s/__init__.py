"""Speed of the 3-SPS-S machine's functions, compared with hand-written NumPy and SciPy."""
