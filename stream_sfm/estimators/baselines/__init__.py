"""Methods for comparison, and the full batch, whose covariance is the bound for all of them."""
