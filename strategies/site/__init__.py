"""The site of a job: the ground that machines may touch, and how they drive on it."""
