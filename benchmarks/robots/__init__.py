"""Speed of the forward and reverse analysis of three robots, compared with ssik's compiled solvers and EAIK."""
