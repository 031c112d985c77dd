"""What survives the server: a database, and bytes by their SHA-256.

    store = Store(settings)     # brings the tables up to date, or refuses in a sentence

models, migrations  the tables, and the steps that lead to them
database   one engine for SQLite and PostgreSQL; migrate or refuse
blobs      bytes of files and results in the folder
holding    one service at a time on a folder and on a database
base       what the parts share; names that may be used
tokens, files, jobs, fleets  the parts of the store
whole      all of them
backup     a copy of all while the service runs; bytes that nobody names swept away
restore    such a copy brought back, into either database
"""

from planner.service.store.whole import Store, opened

__all__ = ["Store", "opened"]
