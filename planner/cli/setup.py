"""`headland setup`: everything compiled beforehand."""

from __future__ import annotations

from planner.cli.common.terminal import LOADING, compile_missing, estimate_compile_s, print_sentence


def setup() -> None:
    """Compile everything for this machine now, on all cores, so that no command waits for it later.

    Example: headland setup
    """
    from planner.cli.common.progress import open_stage_bar

    with open_stage_bar(LOADING) as bar:
        from planner.pipeline.kernels import COMPILING, MORE, PLAN, list_missing_kernels

        missing = list_missing_kernels((PLAN, MORE))
        bar.expect({COMPILING: estimate_compile_s(missing)})
        compile_missing(missing, bar)
        count = len(missing) - len(list_missing_kernels((PLAN, MORE)))
    print_sentence(f"Compiled {count} functions for this machine." if missing else "Everything is compiled already.")
