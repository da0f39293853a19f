"""The candidates that the library lists: screen them by what a fit leaves, refit the best, judge them."""
