"""How fast are the 3-SPS-S machine's functions, beside NumPy and SciPy by hand?"""
