"""Whether a fit is good enough: lack of fit, the error on poses held out, and what a further effect is worth."""
