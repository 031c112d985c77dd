"""The evaluation of candidates in a planning context: bounds, simulation, repair and measured ground."""
