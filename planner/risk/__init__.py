"""Risk and cost of a plan: random inputs, Monte Carlo simulation, prices, and the choice between plans."""
