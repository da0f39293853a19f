"""Demonstrations of modelling assumptions: `demonstration` has the types, `page` writes them, the other files are their contents."""
