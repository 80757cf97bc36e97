"""The commands, a file for each family: what each takes, and what it prints. No mathematics.

Every file has a function ``add_to(command)``, which adds its commands to the parser. What a command needs is imported
when it runs, so that ``rodgen --help`` never waits.
"""
