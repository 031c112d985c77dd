"""The pages of the service: static files and how they are served; they use REST and link as any client does.

    mount               the page at / and its parts under /static
    static/js           one module for each thing: link (WebSocket), api (HTTP), map, layers, coverage, charts, camera,
                        control and remote (hands on a tractor), player, jobs, files, table, words; pages/ has the pages
    static/css          tokens (colours, sizes), base (elements), parts (panels, tables), live (maps, control)
"""

from planner.service.pages.mount import mount

__all__ = ["mount"]
