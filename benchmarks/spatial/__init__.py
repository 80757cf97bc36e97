"""How fast are the functions for spatial mechanisms, beside NumPy and SciPy by hand and the machine's limits?"""
