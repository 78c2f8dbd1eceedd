"""Contact laws: parameters, and the compiled forces."""
