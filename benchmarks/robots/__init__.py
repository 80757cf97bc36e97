"""Forward and reverse analysis of three industrial robots, beside ssik's compiled solvers and EAIK."""
