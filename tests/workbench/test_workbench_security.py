"""Who gets in: the token, the cookie, this host, this origin; and nothing from a network."""

from __future__ import annotations

import re

import pytest

pytest.importorskip("dash")

from geoerr.workbench.app import make_app
from geoerr.workbench.security import Guard
from geoerr.workbench.session import Session

PORT = 8123
HOST = f"127.0.0.1:{PORT}"


@pytest.fixture
def guard() -> Guard:
    return Guard(PORT)


@pytest.fixture
def client(guard: Guard):
    return make_app(Session(), guard).server.test_client()


def get(client, path: str, **headers: str):
    return client.get(path, headers={"Host": HOST, **headers})


def enter(client, guard: Guard) -> None:
    assert get(client, f"/?token={guard.token}").status_code == 303


@pytest.mark.parametrize(
    "path", ["/", "/_dash-layout", "/_dash-dependencies", "/model.json", "/assets/workbench.css"]
)
def test_nobody_gets_in_without_the_token(client, path: str) -> None:
    assert get(client, path).status_code == 403
    assert get(client, f"{path}?token=guess").status_code == 403


def test_the_token_becomes_a_cookie_that_scripts_cannot_read(client, guard: Guard) -> None:
    answer = get(client, f"/?token={guard.token}")
    assert answer.headers["Location"] == "/"
    cookie = answer.headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert get(client, "/").status_code == 200
    assert get(client, "/_dash-layout").status_code == 200


def test_tokens_differ() -> None:
    assert Guard(PORT).token != Guard(PORT).token


def test_another_host_is_refused_even_with_the_cookie(client, guard: Guard) -> None:
    enter(client, guard)
    for host in ("evil.example", f"evil.example:{PORT}", "127.0.0.1:1", "127.0.0.1"):
        assert client.get("/", headers={"Host": host}).status_code == 403


def test_another_origin_is_refused_even_with_the_cookie(client, guard: Guard) -> None:
    enter(client, guard)
    for origin in ("http://evil.example", "null", "http://127.0.0.1:1", f"https://{HOST}"):
        answer = client.post("/_dash-update-component", json={}, headers={"Host": HOST, "Origin": origin})
        assert answer.status_code == 403, origin
    assert get(client, "/", Origin=f"http://{HOST}").status_code == 200
    for site in ("cross-site", "same-site"):
        assert get(client, "/", **{"Sec-Fetch-Site": site}).status_code == 403


def test_the_page_asks_nothing_of_any_other_host(client, guard: Guard) -> None:
    enter(client, guard)
    answer = get(client, "/")
    page = answer.get_data(as_text=True)
    sources = re.findall(r'(?:src|href)="([^"]+)"', page)
    assert sources
    assert all(source.startswith("/") and not source.startswith("//") for source in sources)
    policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "http" not in policy
