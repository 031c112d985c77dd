"""Laws of parameters: with what the value of an effect changes, and what unexplained residuals depend on."""
