"""Demonstrations of modelling assumptions: `demonstration` has the types, `page` writes them, all else are their contents."""
