"""The service over HTTP, below /api/v1.

    app = create_app(Settings(data=folder))

app        all of it together
answers    what answers look like, refusals among them
refusals   errors as answers
health     whether it runs
files      fields, tractors, farms, logs
jobs       plans, days, diagnoses
exports    a plan that was made, for terminals and maps
queries    parameters of addresses and parts of forms that are not known
tokens     made, listed and revoked by who administers
events     who did what
docs       the documentation page, which needs no internet
"""

from planner.service.api.app import create_app

__all__ = ["create_app"]
