"""The parts of the method ``prior``; `priorfill.methods.gpr.gpr_fill` joins them."""
