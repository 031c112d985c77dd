"""Attacks on a running service from outside, each bounded in count and time, on loopback alone.

    python -m tests.benchmarks.attack                                  # all of it, about 20 minutes
    python -m tests.benchmarks.attack --short                          # as in tests, about a minute and a half
    python -m tests.benchmarks.attack --only 2,3 --json > now.json
    python -m tests.benchmarks.attack --command '/opt/headland/bin/headland serve' --before before.json

A service is started in a process of its own with a folder of its own on a free port, and ended with all its processes.
The clients are the attacker's: plain sockets, http.client and websockets. Nothing of planner.service is imported. Each
row of the table says what was attacked, the figure, the limit and whether it held; the exit status is 1 where one did
not. `--command` attacks another checkout or an installed Headland, and `--before` shows the figures of an earlier run
(`--json`) beside those of this one. Tokens are made with roles, or with the older scopes where there are no roles.

Item and what is attacked:

     1  uploads, and headland field: files that read other files, call addresses or create files
     2  large bodies of JSON, without a token and with one that may not, while everybody is told to stand
     3  slow summaries, while everybody is told to stand
     4  every route that is read, without a token, through a proxy that sets Host: 127.0.0.1
     5  links of a page behind a proxy with HTTPS on port 443, and of a page of another site
     6  tractors of two fleets that drive at each other
     7  PostgreSQL stopped or frozen behind a relay (skipped where there is none: HEADLAND_TEST_POSTGRESQL)
     8  1,100 connections that never finish against 1,024 descriptors
     9  kill -9 while headland robot drives, and the service that comes after it
    10  a robot's token for what is not its own, an expired token, a displaced robot
    11  slow files of one client while another uploads
    12  a full disk, a small file system in memory (skipped where none may be mounted)
    13  entities behind a comment, damaged backups, clocks an hour off
    14  SQLite locked by another program, and its file moved away, while a token is revoked
    15  bodies of 50 MB from an operator, while everybody is told to stand
    16  a token with the name of a revoked one, clients that go away, video of other machines

Modules: running (order), rows (table), service (the process), web and robots (clients), squad (many robots and orders
to stand), flooding (processes that flood), relay (TCP in between), plans; the others hold an attack or two each.
"""
