"""Tokens in memory: who is known stays known without the database, and who is not no longer than a second."""

import asyncio
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
import sqlalchemy as sa

from planner.service.errors import TokenError
from planner.service.store import database_watch
from planner.service.store.database_watch import TokenCache
from planner.service.store.service_store import Store
from planner.service.store.tables import TokenRow
from tests.service.conftest import wait_until

PATIENCE_S = 60.0  # for what happens within a second, on a machine that does much else


@pytest.fixture
def book(store: Store) -> Iterator[TokenCache]:
    """The tokens of a store on each database in turn, read every second."""
    book = TokenCache(store)
    book.start()
    yield book
    book.close()


class Lost:
    """A store whose database does not answer while `lost`, or answers only after so long."""

    def __init__(self, store: Store) -> None:
        self.store, self.lost, self.wait_s, self.asked = store, False, 0.0, 0

    def list_tokens(self) -> list[TokenRow]:
        self.asked += 1
        time.sleep(self.wait_s)
        if self.lost:
            raise sa.exc.OperationalError("SELECT", {}, ConnectionError("the server is gone"))
        return self.store.list_tokens()


@pytest.fixture
def lost(plain: Store) -> Lost:
    return Lost(plain)


@pytest.mark.slow
def test_tokens_of_another_process_are_found_and_revoked_ones_are_not(book: TokenCache, store: Store) -> None:
    text = store.create_token_text("office", "read")
    assert book.find_token(text) is None, "nothing was read since"
    assert asyncio.run(book.identify_token(text)).name == "office" and book.find_token(text) is not None
    other = store.create_token_text("phone", "read")
    assert asyncio.run(book.identify_token(other)).name == "phone"
    store.revoke_token("office")
    wait_until(lambda: book.find_token(text) is None)
    with pytest.raises(TokenError, match="token is unknown"):
        asyncio.run(book.identify_token(text))
    for odd in ("", "hl_", "office", "\0", "\ud800", "hl_" + "x" * 100_000):
        with pytest.raises(TokenError):
            asyncio.run(book.identify_token(odd))


def test_an_expired_token_is_worth_nothing_at_once_even_without_the_database(lost: Lost) -> None:
    text = lost.store.create_token_text("guest", "read", expires="1d")
    book = TokenCache(lost)  # type: ignore[arg-type]
    assert book.refresh() and book.find_token(text) is not None
    lost.lost = True
    row = book.find_token(text)
    assert row is not None
    row.expires = "2026-01-01T00:00:00.000Z"
    assert book.find_token(text) is None
    assert list(book.find_invalid_tokens([row.sha256]).values()) == [
        "The token of this link has expired; link again with another one."
    ]
    with pytest.raises(TokenError, match="expired at 2026-01-01"):
        asyncio.run(book.identify_token(text))


@pytest.mark.slow
def test_who_was_known_stays_known_while_the_database_is_gone(lost: Lost) -> None:
    text, later_s = lost.store.create_token_text("office", "operator"), [0.0]
    book = TokenCache(lost, lambda: time.monotonic() + later_s[0])  # type: ignore[arg-type]
    book.start()
    lost.lost = True
    wait_until(lambda: book.last_error is not None)
    assert "the server is gone" in str(book.last_error)
    for later_s[0] in (0.0, 60.0):  # however long it is gone
        assert asyncio.run(book.identify_token(text)).scopes == "operator"
    assert not book.is_fresh
    assert "was revoked" in book.find_invalid_tokens(["0" * 64])["0" * 64]
    lost.store.revoke_token("office")
    assert book.find_token(text) is not None
    lost.lost = False
    wait_until(lambda: book.find_token(text) is None)
    assert book.last_error is None and book.age_s < PATIENCE_S
    book.close()


@pytest.mark.slow
def test_a_database_that_hangs_holds_up_nobody_who_is_known(lost: Lost, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(database_watch, "TIMEOUT_S", 0.8)
    text = lost.store.create_token_text("office", "operator")
    book = TokenCache(lost)  # type: ignore[arg-type]
    book.start()
    lost.wait_s = 3 * database_watch.TIMEOUT_S
    with pytest.raises(TokenError):  # waits for a reading that does not end
        asyncio.run(book.identify_token("hl_unknown"))
    begin = time.monotonic()
    assert asyncio.run(book.identify_token(text)).name == "office" and time.monotonic() - begin < 0.5
    begin = time.monotonic()
    with pytest.raises(TokenError):
        asyncio.run(book.identify_token("hl_unknown"))
    assert time.monotonic() - begin < 2 * database_watch.TIMEOUT_S
    book.close()


def test_unknown_tokens_ask_the_database_a_few_times_a_second_at_most(lost: Lost) -> None:
    book = TokenCache(lost)  # type: ignore[arg-type]
    book.start()
    lost.asked, begin = 0, time.monotonic()

    async def ask() -> None:
        answers = await asyncio.gather(*(book.identify_token(f"hl_{number}") for number in range(500)),
                                       return_exceptions=True)  # fmt: skip
        assert all(isinstance(each, TokenError) for each in answers)

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(asyncio.run, (ask(), ask())))
    assert lost.asked <= 2 + (time.monotonic() - begin) / 0.2
    book.close()
