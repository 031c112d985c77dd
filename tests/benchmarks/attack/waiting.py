"""Item 11: files of one client that take long to read, while another client reads."""

from __future__ import annotations

import threading
import time
from collections import Counter

from tests.benchmarks.attack.rows import Row
from tests.benchmarks.attack.service import Service
from tests.benchmarks.attack.web import square_field, star_field, upload

ANSWER_S = 5.0
SLOW_FROM, QUICK_FROM = "127.0.0.2", "127.0.0.3"


def attack_with_slow_files(service: Service, short: bool) -> list[Row]:
    """Upload slow files with one token, small ones with another."""
    points, files, seconds = (20_000, 3, 8.0) if short else (250_000, 6, 90.0)
    slow, quick = service.new_token(["planner"]), service.new_token(["planner"])
    content, answers = star_field(points), list[tuple[int, float, str]]()

    def send_slow(number: int) -> None:
        answer = upload(service.port, "fields", f"slow{number}.geojson", content, slow, source=SLOW_FROM,
                        timeout_s=seconds + 60.0, local="true")  # fmt: skip
        answers.append((answer.status, round(answer.seconds, 1), answer.body.decode(errors="replace")[:160]))

    threads = [threading.Thread(target=send_slow, args=(number,), daemon=True) for number in range(files)]
    for thread in threads:
        thread.start()
    time.sleep(1.0)
    statuses, worst_s, sentences = _read_meanwhile(service, quick, threads, seconds)
    for thread in threads:
        thread.join(seconds + 60.0)
    told = ", ".join(f"{count} x {status}" for status, count in sorted(statuses.items()))
    slowest = max((each[1] for each in answers), default=0.0)
    words = f"{told}, the slowest {worst_s:.1f} s (slow files {slowest:.0f} s)"
    values = {"statuses": dict(statuses), "worst_s": round(worst_s, 2), "sentences": sentences, "slow": answers}
    return [Row("11", f"small files beside {files} slow ones of another client", words,
                f"all 201 within {ANSWER_S:g} s", set(statuses) == {201} and worst_s <= ANSWER_S, values)]  # fmt: skip


def _read_meanwhile(service: Service, token: str, threads: list[threading.Thread],
                    seconds: float) -> tuple[Counter[int], float, list[str]]:  # fmt: skip
    """Small files of the other client while slow ones are read: statuses, the longest wait and what was refused."""
    statuses, worst_s, sentences, number = Counter[int](), 0.0, list[str](), 0
    until = time.monotonic() + seconds
    while number == 0 or (time.monotonic() < until and any(thread.is_alive() for thread in threads)):
        answer = upload(service.port, "fields", f"quick{number}.geojson", square_field(50.0 + number), token,
                        source=QUICK_FROM, timeout_s=seconds + 30.0, local="true")  # fmt: skip
        statuses[answer.status] += 1
        worst_s, number = max(worst_s, answer.seconds), number + 1
        if answer.status != 201:
            sentences.append(answer.body.decode(errors="replace")[:160])
        time.sleep(0.5)
    return statuses, worst_s, sentences[:3]
