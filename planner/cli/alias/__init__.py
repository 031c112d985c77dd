"""The program's own name as a package: `import headland` and `python -m headland`.

Installing puts the folder below beside `planner` (tool.setuptools.packages.find in pyproject.toml).
"""
