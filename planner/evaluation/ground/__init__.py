"""The ground of a run: swept, worked, unworked, crossed by wheels, and contacts with fences and obstacles."""
