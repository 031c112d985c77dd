"""What a strategy works with: driving rules, costs of turns, dealing of lines, supply, and the legs it writes."""
