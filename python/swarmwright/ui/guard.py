"""What stands before every route: who may ask, from which page, and what a page may load."""

import asyncio
import base64
import contextlib
import hashlib
import hmac
import ipaddress
import re
from collections.abc import Collection
from html import escape
from urllib.parse import parse_qs, parse_qsl, urlencode, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import cookie_parser
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from swarmwright.common.errors import InputError
from swarmwright.ui.sessions import Sessions, TooManyAttemptsError

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Of the window's own pages: no script or style but from its files, no request to anywhere else."""
PLAYER_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
"""Policy of a replay, one document with its scripts: it has its own origin and no network access."""
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
SAFE_METHODS = {"GET", "HEAD"}
TOKEN_PATH = "/~"  # noqa: S105 - a part of addresses
"""Before a token in a path, for frames, which may not keep cookies."""
ANCESTOR = re.compile(r"[a-z][a-z0-9+.-]*://[A-Za-z0-9.*_\[\]:-]+")
HOST = re.compile(r"[a-z0-9_]([a-z0-9_.-]*[a-z0-9_])?")
LOGIN = "/login"
LOGIN_BYTES = 4096
LOGIN_S = 10.0
"""For the whole of a password to come."""
STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:22rem;margin:15vh auto;padding:0 1rem;color:#222;"
    "background:#fff;color-scheme:light dark}input,button{font:inherit;padding:.4rem .7rem;width:100%;"
    "box-sizing:border-box;margin:.3rem 0}.problem{color:#b3261e}@media(prefers-color-scheme:dark){"
    "body{color:#eceff1;background:#16191d}.problem{color:#ff8a80}}"
)
STYLE_HASH = base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode()
LOGIN_POLICY = (
    f"default-src 'none'; style-src 'sha256-{STYLE_HASH}'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'"
)
"""Of the page that asks for the password: nothing but its one style."""
CONTROL = re.compile(r"[\x00-\x1f\x7f]")


class Guard:
    """ASGI middleware that answers requests itself that must not reach the application.

    - 403 for another host name than its own (DNS rebinding), and for requests of another site's page (Origin,
      Sec-Fetch-Site);
    - 401 without the token, which the printed address has; the address loses it, and the browser gets a
      cookie that is derived from it, since the servers of all ports of a host see its cookies. A path that
      begins with `/~TOKEN/` needs no cookie;
    - with a password, a page that asks for it instead;
    - 405 for requests that change something, where `read_only`, but for those that only ask.

    Cookies get the path of the page as browsers see it, so that they work behind a proxy's path, too.

    Args:
        app: the application.
        token: secret; None: whoever reaches the port may see everything.
        hosts: names by which the server is reached, beside those of loopback, as `read_host` returns them.
        port: for the name of the cookie: browsers send cookies to all ports of a host.
        read_only: refuse what changes something.
        asking: paths of requests that have a body and change nothing.
        sessions: of those who have entered a password, which takes the place of the token.
        is_public: whether it is reached by other addresses of this machine than those of loopback.
        ancestors: origins of pages that may show the window in a frame, such as `http://localhost:*`.
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
        sessions: Sessions | None = None,
        is_public: bool = False,
        ancestors: Collection[str] = (),
    ) -> None:
        self._app = app
        self._token = token
        self._hosts = frozenset(hosts)
        self._cookie = f"swarmwright-{port}"
        self._pass = derive_pass(token or "", self._cookie)
        self._read_only = read_only
        self._asking = asking
        self._sessions = sessions
        self._is_public = is_public
        self._ancestors = " ".join(ancestors)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or let the application answer."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":  # there are no web sockets
            await Response(status_code=404)(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
                if self._ancestors:
                    policy = headers["Content-Security-Policy"]
                    headers["Content-Security-Policy"] = allow_ancestors(policy, self._ancestors)
            await send(message)

        scope, has_token = self._strip_token(scope)
        path = path_below(scope)
        headers = Headers(scope=scope)
        answer = self._refuse(scope, headers, path)
        if answer is None and self._sessions is not None:
            answer = await self._ask_for_password(self._sessions, scope, headers, receive, path)
        elif answer is None and not has_token:
            answer = self._ask_for_token(scope, headers)
        await (answer or self._app)(scope, receive, send_with_headers)

    def _strip_token(self, scope: Scope) -> tuple[Scope, bool]:
        """Return the scope of a path without its token, and whether it has the right one."""
        path = path_below(scope)
        if self._token is None or not path.startswith(TOKEN_PATH):
            return scope, False
        token, slash, _ = path.removeprefix(TOKEN_PATH).partition("/")
        if not slash or not self._is_token(token):
            return scope, False
        return {**scope, "root_path": f"{scope.get('root_path', '')}{TOKEN_PATH}{token}"}, True

    def _refuse(self, scope: Scope, headers: Headers, path: str) -> Response | None:
        host = headers.get("host", "")
        if not self._is_own(host):
            return PlainTextResponse(
                f"Host {host[:200]!r} is not a name of this server; start it with --host-name NAME.", 403
            )
        if not is_of_own_page(headers, host, is_navigation=scope["method"] in SAFE_METHODS):
            return PlainTextResponse("This request was made by a page of another site.", 403)
        if CONTROL.search(path):
            return PlainTextResponse("There is no such page.", 404)
        is_change = scope["method"] not in SAFE_METHODS and path not in self._asking
        if self._read_only and is_change and not (path == LOGIN and self._sessions):
            return PlainTextResponse("This window is read-only (--read-only).", 405)
        return None

    def _ask_for_token(self, scope: Scope, headers: Headers) -> Response | None:
        if self._token is None:
            return None
        query = parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True)
        if any(key == "token" and self._is_token(value) for key, value in query):
            rest = urlencode([(key, value) for key, value in query if key != "token"])
            address = f"./?{rest}" if rest else "./"
            if headers.get("sec-fetch-site") == "cross-site":
                # After a link on another site, as of the page that the command opens, browsers keep the new
                # cookie back from a redirect, but not from a page's own request.
                return self._with_cookie(scope, HTMLResponse(forwarding_page(address)), self._pass)
            return self._with_cookie(scope, RedirectResponse(address, 303), self._pass)
        kind, _, token = headers.get("authorization", "").partition(" ")
        if kind.lower() == "bearer" and self._is_token(token):
            return None
        if hmac.compare_digest(self._read_cookie(headers).encode(), self._pass.encode()):
            return None
        return PlainTextResponse("Open the address that `swarmwright ui` printed: it has the token.", 401)

    async def _ask_for_password(
        self, sessions: Sessions, scope: Scope, headers: Headers, receive: Receive, path: str
    ) -> Response | None:
        if path == LOGIN and scope["method"] == "POST":
            client = scope.get("client") or ("", 0)
            try:
                password = await asyncio.wait_for(read_password(receive), LOGIN_S)
                session = sessions.open(str(client[0]), password)
            except TooManyAttemptsError as error:
                refusal = login_page(f"Too many attempts; try again in {error.seconds:.0f} s.", 429)
                refusal.headers["Retry-After"] = f"{error.seconds:.0f}"
                return refusal
            except (TimeoutError, ValueError):
                return login_page("The password was not understood.", 400)
            if session is None:
                return login_page("That is not the password.", 401)
            return self._with_cookie(scope, RedirectResponse("./", 303), session)
        if sessions.is_open(self._read_cookie(headers)):
            return RedirectResponse("./", 303) if path == LOGIN else None
        if path in {"/", "", LOGIN}:
            return login_page("", 401)
        return PlainTextResponse("Enter the password: reload the page.", 401)

    def _with_cookie(self, scope: Scope, response: Response, value: str) -> Response:
        # Without a path, the cookie gets that of the page, with the part that a proxy has taken off.
        response.set_cookie(
            self._cookie,
            value,
            httponly=True,
            samesite="strict",
            path=None,
            secure=scope["scheme"] == "https",
        )
        return response

    def _read_cookie(self, headers: Headers) -> str:
        return cookie_parser(headers.get("cookie", "")).get(self._cookie, "")

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
            # An address, unlike a name, cannot be rebound.
            return ipaddress.ip_address(name).is_loopback or self._is_public
        except ValueError:
            return False


def derive_pass(token: str, cookie: str) -> str:
    """Return what a cookie has instead of the token: it does not open the printed address."""
    return hmac.new(token.encode(), cookie.encode(), hashlib.sha256).hexdigest()


def forwarding_page(address: str) -> str:
    """Return a page that leads to an address by itself, or where browsers do not allow that, by a link."""
    return (
        '<!doctype html><meta charset="utf-8">'
        f'<meta http-equiv="refresh" content="0; url={escape(address)}"><link rel="icon" href="data:,">'
        f'<title>Swarmwright</title><a href="{escape(address)}">Swarmwright</a>'
    )


def read_host(text: str) -> str:
    """Return the name or the address of a host as browsers send it. Raises InputError where it is none."""
    try:
        return str(ipaddress.ip_address(text.removeprefix("[").removesuffix("]")))
    except ValueError:
        pass
    with contextlib.suppress(UnicodeError):
        host = text.encode("idna").decode().lower()
        if HOST.fullmatch(host):
            return host
    raise InputError(
        f"host name {text[:100]!r}: must be a name alone, such as lab.example, without scheme, port and path"
    )


def path_below(scope: Scope) -> str:
    """Return the path of a request below that of the application, which a server in front may set."""
    path, root = str(scope["path"]), str(scope.get("root_path", ""))
    return path.removeprefix(root) if path == root or path.startswith(f"{root}/") else path


def check_ancestors(origins: Collection[str]) -> None:
    """Raise InputError for what is no origin."""
    for origin in origins:
        if origin != "'self'" and ANCESTOR.fullmatch(origin) is None:
            raise InputError(
                f"frame_ancestors: {origin[:100]!r} is not an origin such as 'http://localhost:*' or "
                "'https://hub.example'"
            )


def allow_ancestors(policy: str, ancestors: str) -> str:
    """Return a policy that also allows pages of these origins to show the window in a frame.

    policy: ends with `frame-ancestors`.
    """
    first, _, present = policy.partition("frame-ancestors ")
    allowed = dict.fromkeys([*present.replace("'none'", "").split(), *ancestors.split()])
    return f"{first}frame-ancestors {' '.join(allowed)}"


async def read_password(receive: Receive) -> str:
    """Return the password of a form. Raises ValueError where there is none."""
    body = b""
    while True:
        message = await receive()
        if message["type"] != "http.request":
            raise ValueError
        body += message.get("body", b"")
        if len(body) > LOGIN_BYTES:
            raise ValueError
        if not message.get("more_body", False):
            break
    [password] = parse_qs(body.decode("ascii"), max_num_fields=3).get("password", [""])
    return str(password)


def login_page(problem: str, status: int) -> Response:
    """Return the page that asks for the password."""
    alert = f'<p class="problem" role="alert">{escape(problem)}</p>' if problem else ""
    page = (
        '<!doctype html><html lang="en"><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><title>Swarmwright</title>'
        f"<style>{STYLE}</style><h1>Swarmwright</h1>{alert}"
        '<form method="post" action="login"><label>Password '
        '<input type="password" name="password" autocomplete="current-password" required autofocus></label>'
        "<button>Log in</button></form></html>"
    )
    # With `no-referrer`, browsers send the form with the origin `null`.
    headers = {"Content-Security-Policy": LOGIN_POLICY, "Referrer-Policy": "same-origin"}
    return HTMLResponse(page, status, headers)


def is_of_own_page(headers: Headers, host: str, *, is_navigation: bool) -> bool:
    """Return whether a request comes from this server's pages, or from an address bar.

    is_navigation: whether it changes nothing, and may come from a link elsewhere, without the cookie.
    """
    origin = headers.get("origin")
    try:
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return False
    except ValueError:
        return False
    site = headers.get("sec-fetch-site", "same-origin")
    if site in {"same-origin", "none"}:
        return True
    return is_navigation and headers.get("sec-fetch-mode") == "navigate"
