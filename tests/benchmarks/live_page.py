"""How soon the page of a plan answers: `python -m tests.benchmarks.live_page [--field iwamizawa] [--changes 200]`.

A service of its own and Chromium on this machine. The six controls that move are set to random places, one after the
other, some by their sliders and some by their texts. Told are the times from the event of the control to the frame that
shows an answer to it.
"""

import argparse
import os
import random
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Page

from tests.browsers import LONGEST_WAIT_S, open_browser
from tests.service.running import run_service
from tests.service.watching import WIDE

KNOBS = ("width", "tractors", "speed_kmh", "start", "deadline", "price_per_hour")
QUIET_S = 1.0
CHANGE = """([name, share, typed]) => {
  const text = document.querySelector(`input[name="${name}"]`);
  const range = text.closest(".knob").querySelector("[type=range]");
  const box = document.querySelector(".answer"), before = text.value;
  const steps = Math.round((range.max - range.min) / range.step), place = Math.round(share * steps);
  range.value = Number(range.min) + place * range.step;
  const begun = performance.now();
  range.dispatchEvent(new Event("input", { bubbles: !typed }));
  if (typed) text.dispatchEvent(new Event("input", { bubbles: true }));
  if (text.value === before) return null;
  if (box.getAttribute("aria-busy") !== "true") throw Error(`${name} asked for nothing`);
  return new Promise((shown) => {
    const look = () => {
      if (box.getAttribute("aria-busy") === "true") return requestAnimationFrame(look);
      requestAnimationFrame(() => setTimeout(() => shown({
        ms: performance.now() - begun, words: box.querySelector(".state").textContent, text: text.value })));
    };
    look();
  });
}"""
"""Set a control to a share of its range; milliseconds until the frame with the answer is there, null for no change."""


def change_at_random(page: Page, changes: int, seed: int, wait_s: float) -> list[tuple[str, float]]:
    """Control and milliseconds of every change."""
    drawn, found = random.Random(seed), list[tuple[str, float]]()
    while len(found) < changes:
        name = drawn.choice(KNOBS)
        seen: dict[str, Any] | None = page.evaluate(CHANGE, [name, drawn.random(), drawn.random() < 0.5])
        if seen is not None:
            found.append((name, float(seen["ms"])))
            page.wait_for_timeout(1000.0 * drawn.uniform(0.0, 2.0 * wait_s))
    return found


def format_times(name: str, ms: list[float]) -> str:
    """Median, 95th percentile and worst of a control."""
    if not ms:
        return f"{name:15} none"
    p50, p95 = np.percentile(ms, (50, 95))
    return f"{name:15} {len(ms):4d} changes: median {p50:4.0f} ms, p95 {p95:4.0f} ms, worst {max(ms):4.0f} ms"


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.live_page")
    parser.add_argument("--field", default="iwamizawa")
    parser.add_argument("--changes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=48)
    parser.add_argument("--wait", type=float, default=0.3, help="mean pause between an answer and the next change, s")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, run_service(Path(folder) / "data") as service:
        token = service.make_token("planner")["authorization"].removeprefix("Bearer ")
        with open_browser() as browser:
            page = browser.new_context(viewport=WIDE).new_page()
            page.set_default_timeout(1000 * LONGEST_WAIT_S)
            page.add_init_script(f'sessionStorage.setItem("headland-token", "{token}")')
            page.goto(f"http://127.0.0.1:{service.port}/#/plan?field={given.field}&width=3&tractors=1-3")
            page.wait_for_selector(".answer[aria-busy=false] .badge:visible")
            page.wait_for_timeout(1000.0 * QUIET_S)
            found = change_at_random(page, given.changes, given.seed, given.wait)
    for name in KNOBS:
        print(format_times(name, [ms for one, ms in found if one == name]))
    print(format_times("all", [ms for _, ms in found]))
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
