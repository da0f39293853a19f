"""What a declared model lacks: explanations, compared by the marginal likelihood of the data."""
