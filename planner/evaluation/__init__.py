"""The evaluation of candidates in a planning context: composed, driven and measured."""
