"""Faults put into clean blind films: what is read must be the original points, or the first look must name the fault."""
