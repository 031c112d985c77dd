"""Item 5: links through a proxy with HTTPS."""

from collections.abc import Mapping

from tests.benchmarks.attack.plans import lay_lines, make_fleet
from tests.benchmarks.attack.robots import greet
from tests.benchmarks.attack.rows import Row
from tests.benchmarks.attack.service import Service

FARM = "farm.example"
PROXIES: dict[str, dict[str, str]] = {
    "as it is": {}, "X-Forwarded-Proto": {"X-Forwarded-Proto": "https"},
    "all headers": {"X-Forwarded-Proto": "https", "X-Forwarded-For": "192.0.2.7", "X-Real-IP": "192.0.2.7"},
}  # fmt: skip


def attack_through_proxy(service: Service, short: bool) -> list[Row]:
    """Item 5: links as a proxy with HTTPS on port 443 passes them, of the page and of a page of another site."""
    fleet = make_fleet(service, "behind https", lay_lines(2, 50.0))
    token, rows = service.token("operator", "planner"), list[Row]()
    for number, (how, added) in enumerate(PROXIES.items()):
        if short and number == 2:
            continue
        kind, sentence = _greet_from(service, fleet, token, f"https://{FARM}", added)
        rows.append(Row(f"5{'abc'[number]}", f"link of https://{FARM}, Host {FARM}, {how}",
                        f"{kind} {sentence[:60]}".strip(), "welcome", kind == "welcome",
                        {"answer": kind, "sentence": sentence}))  # fmt: skip
    kind, sentence = _greet_from(service, fleet, token, "https://evil.example", {})
    rows.append(Row("5d", f"link of https://evil.example, Host {FARM}", kind, "refused", kind != "welcome",
                    {"answer": kind, "sentence": sentence}))  # fmt: skip
    return rows


def _greet_from(service: Service, fleet: str, token: str, origin: str, added: Mapping[str, str]) -> tuple[str, str]:
    kind, sentence, _ = greet(service.port, fleet, "control", token, host=FARM, headers={"Origin": origin, **added})
    return kind, sentence
