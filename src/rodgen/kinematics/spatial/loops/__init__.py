"""Reverse analysis of closed loops of groups 1 and 2, and of robots with slides, which are such loops."""
