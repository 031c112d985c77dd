"""Effects as coordinates, and fits of them."""
