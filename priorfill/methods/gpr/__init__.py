"""The parts of the default method, ``gpr``; `priorfill.methods.gpr.gpr_fill` joins them."""
