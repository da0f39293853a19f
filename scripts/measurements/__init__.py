"""What the documentation's numbers were measured by; see `scripts.measure`."""
