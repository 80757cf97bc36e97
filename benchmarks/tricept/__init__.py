"""How fast are the Tricept's functions, beside NumPy written by hand?"""
