"""Who may ask the server what: this browser, of this page only, after the one-time token."""

import hmac
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]

HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; connect-src 'self'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; frame-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'self'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
"""Of every answer; an answer that has one of them already keeps its own."""


PLACE = b"x-workspace"  # header of a refusal: which folder the app is on, as a hash
NEEDS_TOKEN = (
    "Open the address that `steelyard app` printed, with its token. It works once; "
    "for another browser start the app again."
)
"""The answer to who has no session."""


@dataclass(eq=False)
class Guard:
    """Passes on what may be asked, and refuses all else, WebSockets included.

    A token opens one session, which the browser keeps as a cookie until it is closed. The name of
    the host is compared, so that no other name leads here (DNS rebinding); so is the origin, so
    that no other page asks in this browser's name.
    """

    application: Application
    port: int
    place: str = ""
    token: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    session: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    used: bool = False

    @property
    def cookie(self) -> str:
        """Name of the cookie; browsers share cookies between ports."""
        return f"steelyard-{self.port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or pass on."""
        if scope["type"] == "lifespan":
            return await self.application(scope, receive, send)
        if scope["type"] != "http":
            await receive()
            return await send({"type": "websocket.close", "code": 1008})
        if self._foreign(scope):
            return await _refuse(send, "This address is not for other pages or hosts.")
        if self._known(scope):
            return await self.application(scope, receive, self._with_headers(send))
        query = parse_qs(scope["query_string"].decode("latin-1"))
        given = query.get("token", [""])[0]
        opens = scope["path"] == "/" and scope["method"] == "GET" and not self.used
        if not (opens and hmac.compare_digest(given.encode(), self.token.encode())):
            return await _refuse(send, NEEDS_TOKEN, self.place)
        self.used = True
        value = f"{self.cookie}={self.session}; Path=/; HttpOnly; SameSite=Strict"
        headers = [(b"location", b"/"), (b"set-cookie", value.encode())]
        await self._with_headers(send)(
            {"type": "http.response.start", "status": 303, "headers": headers}
        )
        await send({"type": "http.response.body", "body": b""})

    def _foreign(self, scope: Scope) -> bool:
        """Whether another page asks, or this one by another name of the host."""
        headers = [
            (name.decode("latin-1"), value.decode("latin-1")) for name, value in scope["headers"]
        ]
        hosts = [value for name, value in headers if name == "host"]
        own = {f"{name}:{self.port}" for name in ("127.0.0.1", "localhost")}
        if len(hosts) != 1 or hosts[0] not in own:
            return True
        origins = [value for name, value in headers if name == "origin"]
        sites = [value for name, value in headers if name == "sec-fetch-site"]
        if any(site not in ("same-origin", "none") for site in sites):
            return True
        if scope["method"] not in ("GET", "HEAD") and len(origins) != 1:
            return True
        return any(origin != f"http://{hosts[0]}" for origin in origins)

    def _known(self, scope: Scope) -> bool:
        """Whether the session's cookie is there."""
        for name, value in scope["headers"]:
            if name != b"cookie":
                continue
            try:
                found = SimpleCookie(value.decode("latin-1")).get(self.cookie)
            except CookieError:
                continue
            if found is not None and hmac.compare_digest(
                found.value.encode(), self.session.encode()
            ):
                return True
        return False

    def _with_headers(self, send: Send) -> Send:
        async def sending(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                given = list(message.get("headers", []))
                there = {name.lower() for name, _ in given}
                given += [
                    (name.encode(), value.encode())
                    for name, value in HEADERS.items()
                    if name.encode() not in there
                ]
                message = {**message, "headers": given}
            await send(message)

        return sending


async def _refuse(send: Send, words: str, place: str = "") -> None:
    headers = [
        (PLACE, place.encode()),
        (b"content-type", b"text/plain; charset=utf-8"),
        (b"x-content-type-options", b"nosniff"),
    ]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": words.encode()})
