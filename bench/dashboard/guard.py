"""Who may look at the dashboard, and who may ask for something.

- On a loopback address no token is asked for, and only names of this machine are answered to: a web page elsewhere
  that points its own name at 127.0.0.1 (DNS rebinding) gets nothing.
- On any other address a token is asked for; a browser that brought it keeps a cookie, a program sends
  ``Authorization: Bearer TOKEN``.
- What comes from another web site is refused: every request that is not a plain look at a page, and every
  websocket, must have this server as its origin. No other site may show these pages in a frame.
"""

import hmac
import ipaddress
import secrets
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import urlsplit

COOKIE = "d2ea_session"
LOGIN = "/login"
LOCAL_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
SAFE_METHODS = frozenset({"GET", "HEAD"})
HEADERS = (
    (b"x-frame-options", b"DENY"),
    (b"content-security-policy", b"frame-ancestors 'none'"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"same-origin"),
)

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]


def is_loopback(host: str) -> bool:
    """Whether an address to listen on can be reached from this machine only.

    >>> [is_loopback(host) for host in ("127.0.0.1", "localhost", "::1", "0.0.0.0", "192.168.1.5", "lab-pc")]
    [True, True, True, False, False, False]
    """
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What a request says of itself; header names in lower case."""

    method: str
    path: str
    headers: Mapping[str, str]
    websocket: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """Why a request is not answered."""

    status: int
    said: str


@dataclass(frozen=True, slots=True)
class Door:
    """The rules: ``token`` is None on a loopback address. ``sessions`` are the cookies given out."""

    token: str | None = None
    sessions: set[str] = field(default_factory=set)

    def admit(self, offered: str) -> str | None:
        """A session for the right token, None for a wrong one; takes as long either way."""
        if self.token is None or not hmac.compare_digest(offered.encode(), self.token.encode()):
            return None
        session = secrets.token_urlsafe(32)
        self.sessions.add(session)
        return session

    def judge(self, asked: Asked) -> Refusal | None:
        """None for a request that may pass."""
        host = asked.headers.get("host", "")
        if self.token is None and _name(host) not in LOCAL_NAMES:
            return Refusal(status=421, said=f"this dashboard is not called {host!r}")
        if _foreign(asked, host):
            return Refusal(status=403, said="refused: the request comes from another web site")
        if self.token is not None and asked.path != LOGIN and not self._known(asked.headers):
            return Refusal(status=401, said="a token is needed")
        return None

    def _known(self, headers: Mapping[str, str]) -> bool:
        scheme, _, offered = headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer" and self.token is not None:
            return hmac.compare_digest(offered.strip().encode(), self.token.encode())
        try:
            cookie = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        except CookieError:
            return False
        return cookie is not None and cookie.value in self.sessions


def _name(host: str) -> str:
    """The name in a Host header, without port and brackets."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _foreign(asked: Asked, host: str) -> bool:
    """Whether something that can change anything comes from a page that is not ours."""
    looks = asked.method in SAFE_METHODS and not asked.websocket
    if looks:
        return False
    origin, site = asked.headers.get("origin"), asked.headers.get("sec-fetch-site")
    if origin is not None:
        return urlsplit(origin).netloc != host
    return site not in (None, "same-origin", "none")


class Guard:
    """The door in front of an ASGI application."""

    def __init__(self, app: App, door: Door) -> None:
        self._app, self._door = app, door

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        websocket = scope["type"] == "websocket"
        headers = {
            name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]
        }
        asked = Asked(
            method="GET" if websocket else scope["method"],
            path=scope["path"],
            headers=headers,
            websocket=websocket,
        )
        refusal = self._door.judge(asked)
        if refusal is None:
            await self._app(scope, receive, _with_headers(send))
        elif websocket:
            await receive()
            await send({"type": "websocket.close", "code": 1008, "reason": refusal.said})
        else:
            await _refuse(asked, refusal, send)


def _with_headers(send: Send) -> Send:
    async def wrapped(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", ()), *HEADERS]
        await send(message)

    return wrapped


async def _refuse(asked: Asked, refusal: Refusal, send: Send) -> None:
    """Words for a program; a person who needs a token is led to where it is asked for."""
    person = refusal.status == 401 and "text/html" in asked.headers.get("accept", "")
    status = 303 if person else refusal.status
    headers = [(b"content-type", b"text/plain; charset=utf-8"), *HEADERS]
    headers += [(b"location", LOGIN.encode())] if person else []
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": f"{refusal.said}\n".encode()})
