"""What stands before every route: who may ask, from which page, and what a page may load."""

import hmac
import ipaddress
from collections.abc import Collection
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qsl, urlencode, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Of the window's own pages: no script or style but from its files, no request to anywhere else."""
PLAYER_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
"""Of a replay, one document with its scripts: it has an origin of its own and reaches nothing."""
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
SAFE_METHODS = {"GET", "HEAD"}


class Guard:
    """ASGI middleware that answers requests itself that must not reach the application.

    - 403 for another host name than its own (DNS rebinding), and for requests of another site's page (Origin,
      Sec-Fetch-Site);
    - 401 without the token, which the printed address has; it becomes a cookie, and the address loses it;
    - 405 for requests that change something, where `read_only`, but for those that only ask.

    Args:
        app: the application.
        token: secret; None: whoever reaches the port may see everything.
        hosts: names by which the server is reached, beside the addresses of loopback.
        port: for the name of the cookie: browsers send cookies to all ports of a host.
        read_only: refuse what changes something.
        asking: paths of requests that have a body and change nothing.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        token: str | None,
        hosts: Collection[str],
        port: int,
        read_only: bool,
        asking: Collection[str] = (),
    ) -> None:
        self._app = app
        self._token = token
        self._hosts = {host.lower() for host in hosts}
        self._cookie = f"swarmwright-{port}"
        self._read_only = read_only
        self._asking = asking

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or let the application answer."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":  # there are no web sockets
            await Response(status_code=404)(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is not None:
            for name, value in HEADERS.items():
                refusal.headers.setdefault(name, value)
            await refusal(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        await self._app(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope) -> Response | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if not self._is_own(host):
            return PlainTextResponse(
                f"Host {host[:200]!r} is not a name of this server; start it with --host-name NAME.", 403
            )
        if not is_of_own_page(headers, host, is_navigation=scope["method"] in SAFE_METHODS):
            return PlainTextResponse("This request was made by a page of another site.", 403)
        is_change = scope["method"] not in SAFE_METHODS and scope["path"] not in self._asking
        if self._read_only and is_change:
            return PlainTextResponse("This window is read-only (--read-only).", 405)
        if self._token is None:
            return None
        query = parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True)
        if any(key == "token" and self._is_token(value) for key, value in query):
            rest = urlencode([(key, value) for key, value in query if key != "token"])
            response = RedirectResponse(f"./?{rest}" if rest else "./", 303)
            response.set_cookie(self._cookie, self._token, httponly=True, samesite="strict", path="/")
            return response
        if self._is_token(self._token_of(headers)):
            return None
        return PlainTextResponse("Open the address that `swarmwright ui` printed: it has the token.", 401)

    def _token_of(self, headers: Headers) -> str:
        kind, _, token = headers.get("authorization", "").partition(" ")
        if kind.lower() == "bearer":
            return token
        try:
            cookies = SimpleCookie(headers.get("cookie", ""))
        except CookieError:
            return ""
        return cookies[self._cookie].value if self._cookie in cookies else ""

    def _is_token(self, text: str) -> bool:
        return hmac.compare_digest(text.encode(), (self._token or "").encode())

    def _is_own(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        if name == "localhost" or name in self._hosts:
            return True
        try:
            return ipaddress.ip_address(name).is_loopback
        except ValueError:
            return False


def is_of_own_page(headers: Headers, host: str, *, is_navigation: bool) -> bool:
    """Return whether a request comes from this server's pages, or from an address bar.

    is_navigation: whether it changes nothing, and may come from a link elsewhere, without the cookie.
    """
    origin = headers.get("origin")
    if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
        return False
    site = headers.get("sec-fetch-site", "same-origin")
    if site in {"same-origin", "none"}:
        return True
    return is_navigation and headers.get("sec-fetch-mode") == "navigate"
