"""The algorithms, and the paper's settings for them."""
