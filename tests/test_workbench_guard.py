"""Who may ask the server of the workbench: the window that was given its address, and nobody else."""

import asyncio

import pytest

from rodgen.workbench.keep import file_in
from rodgen.workbench.server import Guard

TOKEN, PORT = "abcDEF-123_456", 8123
HOST = ("host", f"127.0.0.1:{PORT}")
ORIGIN = ("origin", f"http://127.0.0.1:{PORT}")


def asked(path=f"/{TOKEN}/", headers=(HOST,), kind="http", body=(b"",)):
    """Return the status and headers of the answer, or how a web socket is closed; and whether the page was reached."""
    sent, reached, parts = [], [], list(body)

    async def page(scope, receive, send):
        reached.append(scope["path"])
        if kind == "http":
            while parts:
                await receive()
            await send({"type": "http.response.start", "status": 200, "headers": []})
            await send({"type": "http.response.body", "body": b"page"})
        else:
            await send({"type": "websocket.accept"})

    async def receive():
        return {"type": "http.request", "body": parts.pop(0), "more_body": bool(parts)}

    async def send(message):
        sent.append(message)

    scope = {
        "type": kind,
        "path": path,
        "headers": [(name.encode(), value.encode("latin-1")) for name, value in headers],
    }
    asyncio.run(Guard(page, TOKEN, PORT, most=1000)(scope, receive, send))
    return sent[0], bool(reached)


def test_the_window_that_was_given_the_address_is_answered():
    answer, reached = asked()
    assert (answer["status"], reached) == (200, True)
    given = dict(answer["headers"])
    assert b"default-src 'self'" in given[b"content-security-policy"]
    assert b"http" not in given[b"content-security-policy"]  # nothing is asked of any network
    assert b"frame-ancestors 'none'" in given[b"content-security-policy"]
    assert given[b"referrer-policy"] == b"no-referrer"
    assert asked(headers=(("host", f"localhost:{PORT}"),))[1]
    assert asked(headers=(HOST, ORIGIN), kind="websocket")[0]["type"] == "websocket.accept"


@pytest.mark.parametrize(
    "path", ["/", "", "/wrong/", f"/{TOKEN}", f"/{TOKEN[:-1]}/", f"/x/../{TOKEN}/", f"//{TOKEN}/", "/ü/"]
)
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_without_the_token_nothing_is_shown(path, kind):
    answer, reached = asked(path, (HOST, ORIGIN), kind)
    assert not reached
    assert answer.get("status", 403) == 403
    assert answer["type"] in {"http.response.start", "websocket.close"}


@pytest.mark.parametrize(
    "headers",
    [
        (("host", f"evil.example:{PORT}"),),  # DNS rebinding: the name of another site that leads here
        (("host", "127.0.0.1"),),
        (("host", f"127.0.0.1:{PORT}.evil.example"),),
        (),
        (HOST, HOST),
        (HOST, ("origin", "https://evil.example")),
        (HOST, ("origin", "null")),
        (HOST, ("origin", f"http://127.0.0.1:{PORT + 1}")),
        (HOST, ("origin", f"http://localhost:{PORT}")),
        (HOST, ORIGIN, ("origin", "https://evil.example")),
        (HOST, ("sec-fetch-site", "cross-site")),
        (HOST, ("sec-fetch-site", "same-site")),
    ],
)
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_other_hosts_origins_and_sites_are_refused(headers, kind):
    answer, reached = asked(headers=headers, kind=kind)
    assert not reached
    assert answer.get("status", 403) == 403


def test_a_web_socket_without_an_origin_is_refused():
    assert not asked(headers=(HOST,), kind="websocket")[1]


def test_uploads_are_bounded():
    assert asked(body=[b"x" * 500, b"x" * 500])[0]["status"] == 200
    answer, reached = asked(headers=(HOST, ("content-length", "1001")))
    assert (answer["status"], reached) == (413, False)
    assert asked(headers=(HOST, ("content-length", "-1")))[0]["status"] == 413
    assert asked(headers=(HOST, ("content-length", "9" * 400)))[0]["status"] == 413
    assert asked(body=[b"x" * 600, b"x" * 600])[0]["status"] == 413  # whose length was not said


@pytest.mark.parametrize(
    "name",
    ["../up.toml", "/etc/x.toml", "a/b.toml", "a\\b.toml", ".hidden.toml", "C:x.toml", "x", "", "x.toml ", "x\0.toml",
     "x\n.toml", "x" * 300 + ".toml", "~root.toml", "$HOME.toml"],
)  # fmt: skip
def test_a_name_that_leads_elsewhere_is_refused(refuses, name):
    refuses(file_in, "/folder", name, ".toml")


def test_usual_names_are_taken():
    assert file_in("/folder", "Ma machine (2).toml", ".toml") == "/folder/Ma machine (2).toml"
    assert file_in("/folder", "größe_c", "") == "/folder/größe_c"
