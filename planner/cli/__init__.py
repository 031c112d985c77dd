"""The command line."""

import os

# Headland has no plugins of pydantic, and to look for some takes a thirtieth of the time of `headland --help`.
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
