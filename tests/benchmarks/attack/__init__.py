"""Attacks on a running service from outside, each bounded in count and time, on loopback alone.

    python -m tests.benchmarks.attack                                  # all of it, about 8 minutes
    python -m tests.benchmarks.attack --short                          # as in tests, about a minute and a half
    python -m tests.benchmarks.attack --only 2,3 --json > now.json
    python -m tests.benchmarks.attack --command '/opt/headland/bin/headland serve' --before before.json

A service is started in a process of its own with a folder of its own on a free port, and ended with all its processes.
The clients are the attacker's: plain sockets, http.client and websockets. Nothing of planner.service is imported. Each
row of the table says what was attacked, the figure, the limit and whether it held; the exit status is 1 where one did
not. `--command` attacks another checkout or an installed Headland, and `--before` shows the figures of an earlier run
(`--json`) beside those of this one.

Item and what is attacked:

     1  uploads, and headland field: files that read other files, call addresses or create files
     2  large bodies of JSON, without a token and with one that may not, while everybody is told to stand
     3  slow summaries, while everybody is told to stand
     5  links of a page behind a proxy with HTTPS on port 443, and of a page of another site
     8  1,100 connections that never finish against 1,024 descriptors
    15  bodies of 50 MB from an operator, while everybody is told to stand

What a service refuses without a load has tests of its own in tests/service and tests/fields.

Modules: running (order), rows (table), service (the process), web and robots (clients), squad (many robots and orders
to stand), flooding (processes that flood), plans; the others hold an attack or two each.
"""
