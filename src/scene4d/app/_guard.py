"""Who may ask: host, origin, token, and how much may be sent."""

import hmac
from collections.abc import Awaitable, Callable, Collection, MutableMapping
from http.cookies import SimpleCookie
from typing import Any
from urllib.parse import parse_qsl, urlencode, urlsplit

from starlette.responses import JSONResponse, RedirectResponse, Response

from scene4d.app._hosts import is_loopback

_MOST_BODY = 1_000_000
"""Bytes of a request: a thousand zones of a dozen corners."""
_COOKIE = "scene4d"
_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
)
Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]


def refusal(status: int, message: str, kind: str = "input") -> JSONResponse:
    """An error in the form of ``--json``."""
    _, semicolon, remedy = message.rpartition("; ")
    error = {"kind": kind, "message": message, "remedy": remedy if semicolon else None}
    return JSONResponse({"error": error}, status_code=status)


class Guard:
    """Refuses what does not come from the page of this server.

    It answers to names of this machine itself, the address that a request came in at, and
    ``names``, so that no page elsewhere can reach it under a name of its own (DNS rebinding). With
    a token every request needs it: ``Authorization: Bearer TOKEN``, or the cookie that
    ``/?token=TOKEN`` sets.
    """

    def __init__(self, app: App, token: str | None, names: Collection[str]) -> None:
        self._app, self._token = app, token
        self._names = {name.lower() for name in names}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request, or pass it on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = {
            key.decode("latin-1"): value.decode("latin-1") for key, value in scope["headers"]
        }
        answer = self._judged(scope, headers)
        sending = _with_headers(send)
        if answer is not None:
            await answer(scope, receive, sending)
        else:
            await self._app(scope, _limited(receive), sending)

    def _judged(self, scope: Scope, headers: dict[str, str]) -> Response | None:
        host = headers.get("host", "")
        if not self._is_here(_name(host).lower(), scope):
            return refusal(
                421, "this server does not go by that name; name it as --public-name", "host"
            )
        origin = headers.get("origin")
        foreign = headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none")
        if origin is not None and urlsplit(origin).netloc != host:
            return refusal(403, "the request comes from another site", "origin")
        if foreign and scope["path"] != "/":
            return refusal(403, "the request comes from another site", "origin")
        if not headers.get("content-length", "0").isdecimal():
            return refusal(400, "content-length is no number")
        if int(headers.get("content-length", "0")) > _MOST_BODY:
            return refusal(413, f"the request is longer than {_MOST_BODY:,} bytes")
        return None if self._token is None else self._identified(scope, headers)

    def _is_here(self, name: str, scope: Scope) -> bool:
        came_in_at = (scope.get("server") or ("",))[0]
        return is_loopback(name) or name in self._names or (name == came_in_at != "")

    def _identified(self, scope: Scope, headers: dict[str, str]) -> Response | None:
        asked = parse_qsl(scope["query_string"].decode("latin-1"))
        given = dict(asked).get("token")
        if scope["path"] == "/" and self._is_token(given):
            rest = urlencode([pair for pair in asked if pair[0] != "token"])
            answer = RedirectResponse(f"/?{rest}" if rest else "/", status_code=303)
            answer.set_cookie(_COOKIE, given or "", httponly=True, samesite="strict")
            return answer
        bearer = headers.get("authorization", "").removeprefix("Bearer ")
        cookie = SimpleCookie(headers.get("cookie", "")).get(_COOKIE)
        if self._is_token(bearer) or (cookie is not None and self._is_token(cookie.value)):
            return None
        return refusal(401, "a token is needed; open /?token=TOKEN", "token")

    def _is_token(self, given: str | None) -> bool:
        assert self._token is not None
        return given is not None and hmac.compare_digest(given.encode(), self._token.encode())


def _name(host: str) -> str:
    """The name or address of a Host header, without its port."""
    if host.startswith("["):
        return host[1:].partition("]")[0]
    return host.rpartition(":")[0] if ":" in host else host


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", ()), *_HEADERS]
        await send(message)

    return sending


def _limited(receive: Receive) -> Receive:
    """A body that was announced shorter than it is, or not at all, ends where it is too long."""
    taken = 0

    async def receiving() -> Message:
        nonlocal taken
        message = await receive()
        taken += len(message.get("body", b""))
        return {"type": "http.disconnect"} if taken > _MOST_BODY else message

    return receiving
