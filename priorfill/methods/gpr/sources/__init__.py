"""Sources of a limb's prediction other than the regression of poses."""
