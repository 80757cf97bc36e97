"""Reverse analysis of arms with six revolute joints."""
