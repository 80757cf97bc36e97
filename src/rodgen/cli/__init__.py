"""The commands of ``rodgen``, one module for each family; no mathematics.

Each module has a function ``add_to(command)`` that adds its commands to the parser. What a command needs is imported
when it runs, so that ``rodgen --help`` is fast.
"""
