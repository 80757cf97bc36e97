"""The workbench: a session in which a machine's model is changed step by step, and the page that shows it.

A session has no mathematics of its own: what it says comes from the functions that commands use. It needs no more than
they do; the page needs ``pip install 'rodgen[app]'``.
"""
