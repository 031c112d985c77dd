"""The service: plans, days and diagnoses as jobs, fleets that drive, and pages in the browser.

Packages below: store, access, gateway, sandbox, jobs, api, fleets (links to tractors and operators), backgrounds,
pages.
"""
