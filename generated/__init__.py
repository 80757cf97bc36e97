"""Code that rodgen generates from its derivations: ``numpy/`` and ``c/``, and ``gufunc/`` for the extension."""
