"""The parts of the method ``prior``; `priorfill.methods.prior.regression_prior` joins them."""
