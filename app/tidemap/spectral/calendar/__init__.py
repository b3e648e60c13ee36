"""The `calendar` estimator: logistic regression on waves of the civil day and week."""
