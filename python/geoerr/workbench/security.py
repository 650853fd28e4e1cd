"""Who may speak to the workbench: the one browser that was given the token, on this computer, from its own page.

Any page in the browser can send requests to a server on loopback. So a request is refused that names another host
(a foreign name that resolves to loopback), that a page of another origin sends, or that carries neither the token
nor the cookie which a request with the token was given.
"""

from __future__ import annotations

import secrets
from typing import Final

from flask import Flask, Request, Response, redirect, request
from werkzeug.wrappers import Response as AnyResponse

HOST: Final = "127.0.0.1"
_NAMES = (HOST, "localhost")
_TOKEN_BYTES = 32
# The page's own scripts and styles, and nothing from anywhere else. Plotly compiles drawing code for the graphics
# card, and Dash starts its page from a script inside it.
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; worker-src 'self' blob:; "
    "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Guard:
    """Lets in what carries the token, and refuses the rest.

    Parameters
    ----------
    port
        On which the page is served: hosts and origins have to name it.
    token
        A new random one where none is given.
    """

    def __init__(self, port: int, token: str | None = None) -> None:
        self.port = port
        self.token = token or secrets.token_urlsafe(_TOKEN_BYTES)
        self._hosts = {f"{name}:{port}" for name in _NAMES}
        self._origins = {f"http://{host}" for host in self._hosts}
        # Cookies know no ports: two workbenches at once must not take each other's.
        self._cookie = f"geoerr-workbench-{port}"
        self.url = f"http://{HOST}:{port}/?token={self.token}"

    def protect(self, server: Flask) -> None:
        """Put the guard before every request of a server, and its headers on every answer."""
        server.before_request(self._admit)
        server.after_request(self._with_headers)

    def _admit(self) -> AnyResponse | None:
        problem = self._problem(request)
        if problem is not None:
            return Response(f"refused: {problem}\n", status=403, mimetype="text/plain")
        if self._is_token(request.args.get("token")):
            # The address without the token: it does not stay in what people copy and show.
            answer = redirect("/", code=303)
            answer.set_cookie(self._cookie, self.token, httponly=True, samesite="Strict", path="/")
            return answer
        if not self._is_token(request.cookies.get(self._cookie)):
            text = "refused: open the address that `geoerr workbench` printed, with its token\n"
            return Response(text, status=403, mimetype="text/plain")
        return None

    def _problem(self, asked: Request) -> str | None:
        if asked.headers.get("Host") not in self._hosts:
            return "another host is named"
        origin = asked.headers.get("Origin")
        if origin is not None and origin not in self._origins:
            return "the request comes from another origin"
        # Browsers that say where a request comes from say it here, without an Origin too.
        if asked.headers.get("Sec-Fetch-Site", "none") not in ("same-origin", "none"):
            return "the request comes from another site"
        return None

    def _is_token(self, text: str | None) -> bool:
        return text is not None and secrets.compare_digest(text.encode(), self.token.encode())

    @staticmethod
    def _with_headers(answer: Response) -> Response:
        for name, value in _HEADERS.items():
            answer.headers[name] = value
        return answer
