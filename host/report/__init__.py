"""Figures and reports of fitted models, in the thesis' numbering."""
