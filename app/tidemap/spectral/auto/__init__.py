"""`auto`: the choice of estimator, order and priors by a history's own days."""
