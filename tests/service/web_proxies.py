"""nginx and Caddy in front of a port, with the configurations of the guide as they are but for names and ports."""

import contextlib
import http.client
import os
import random
import shutil
import socket
import ssl
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

GUIDE = Path(__file__).parents[2] / "planner" / "guide"
NAME, PORT = "farm.example", "127.0.0.1:8765"
START_S = 15.0
NGINX = """\
daemon off;
pid {folder}/nginx.pid;
error_log {folder}/error.log info;
worker_processes 1;
events {{ worker_connections 1024; }}
http {{
    access_log {folder}/access.log;
    client_body_temp_path {folder}/body;
    proxy_temp_path {folder}/proxy;
    fastcgi_temp_path {folder}/fastcgi;
    uwsgi_temp_path {folder}/uwsgi;
    scgi_temp_path {folder}/scgi;
    include {folder}/headland.conf;
}}
"""
"""What /etc/nginx/nginx.conf of a distribution has round the file of the guide; in a folder of its own."""


def has_nginx() -> bool:
    """Whether nginx and openssl are installed."""
    return _find("nginx") is not None and _find("openssl") is not None


def has_caddy() -> bool:
    """Whether Caddy and openssl are installed."""
    return _find("caddy") is not None and _find("openssl") is not None


def make_certificate(folder: Path, name: str = "localhost") -> tuple[Path, Path]:
    """A certificate that signs itself, for a name and 127.0.0.1, and its key."""
    certificate, key = folder / "fullchain.pem", folder / "privkey.pem"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2",
         "-subj", f"/CN={name}", "-addext", f"subjectAltName=DNS:{name},IP:127.0.0.1",
         "-keyout", str(key), "-out", str(certificate)],
        check=True, capture_output=True, timeout=30,
    )  # fmt: skip
    return certificate, key


@contextlib.contextmanager
def run_nginx(folder: Path, port: int, https: int | None = None, name: str = "localhost") -> Iterator[int]:
    """nginx before the service on a port of this machine; yields the port of HTTPS (any free one if not said).

    Its certificate is `folder`/fullchain.pem. To have it listen where no port need be named, say 443 as root.
    """
    make_certificate(folder, name)
    http, https = _free_port(), https or _free_port()
    text = (GUIDE / "nginx.conf").read_text(encoding="utf-8")
    for old, new in (
        ("/etc/ssl/headland/", f"{folder}/"), (PORT, f"127.0.0.1:{port}"), (NAME, name),
        ("listen 80;", f"listen 127.0.0.1:{http};"), ("listen 443 ssl;", f"listen 127.0.0.1:{https} ssl;"),
        ("    listen [::]:80;\n", ""), ("    listen [::]:443 ssl;\n", ""),
    ):  # fmt: skip
        assert old in text, f"{old} is not in the guide's nginx.conf any more"
        text = text.replace(old, new)
    with _run_nginx(folder, text, https, name):
        yield https


@contextlib.contextmanager
def run_bare_nginx(folder: Path, port: int) -> Iterator[int]:
    """nginx with TLS and a proxy_pass alone, as somebody writes it who has not read the guide; yields its port."""
    certificate, key = make_certificate(folder)
    https = _free_port()
    text = (f"server {{ listen 127.0.0.1:{https} ssl; ssl_certificate {certificate}; ssl_certificate_key {key};\n"
            f"location / {{ proxy_pass http://127.0.0.1:{port}; }} }}\n")  # fmt: skip
    with _run_nginx(folder, text, https):
        yield https


@contextlib.contextmanager
def _run_nginx(folder: Path, text: str, https: int, name: str = "localhost") -> Iterator[None]:
    (folder / "headland.conf").write_text(text, encoding="utf-8")
    (folder / "nginx.conf").write_text(NGINX.format(folder=folder), encoding="utf-8")
    words = [str(_find("nginx")), "-p", str(folder), "-c", str(folder / "nginx.conf"), "-e", str(folder / "error.log")]
    with _running(words, folder / "nginx.out", https, name):
        yield


@contextlib.contextmanager
def run_caddy(folder: Path, port: int, name: str = "localhost") -> Iterator[int]:
    """Caddy before the service on a port of this machine; yields the port of HTTPS. Its certificate is as for nginx."""
    certificate, key = make_certificate(folder, name)
    https = _free_port()
    text = (GUIDE / "Caddyfile").read_text(encoding="utf-8")
    for old, new in (
        (PORT, f"127.0.0.1:{port}"), (f"{NAME} {{", f"https://{name}:{https} {{\n\ttls {certificate} {key}"),
        ("\tservers {", "\tadmin off\n\tauto_https disable_redirects\n\tservers {"),
    ):  # fmt: skip
        assert old in text, f"{old} is not in the guide's Caddyfile any more"
        text = text.replace(old, new)
    (folder / "Caddyfile").write_text(text, encoding="utf-8")
    words = [str(_find("caddy")), "run", "--config", str(folder / "Caddyfile"), "--adapter", "caddyfile"]
    homes = {"HOME": str(folder), "XDG_DATA_HOME": str(folder / "data"), "XDG_CONFIG_HOME": str(folder / "config")}
    with _running(words, folder / "caddy.out", https, name, homes):
        yield https


@contextlib.contextmanager
def _running(
    words: list[str], log: Path, port: int, name: str = "localhost", more: dict[str, str] | None = None
) -> Iterator[None]:
    """A program in the foreground that listens with TLS before the body begins, and is ended after it."""
    with log.open("wb") as output:
        process = subprocess.Popen(words, stdout=output, stderr=subprocess.STDOUT, env=os.environ | (more or {}))
        try:
            _wait_for_tls(port, name, process, log)
            yield
        finally:
            process.terminate()
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def connect_over_tls(port: int, host: str = "localhost") -> http.client.HTTPSConnection:
    """A connection to a proxy on this machine, whoever signed for it."""
    return http.client.HTTPSConnection(host, port, timeout=60, context=_trust_anybody())


def ask_over_tls(connection: http.client.HTTPSConnection, method: str, path: str, *sent: Any) -> int:
    """The status of one request, after which the connection is closed."""
    try:
        connection.request(method, path, *sent)
        return connection.getresponse().status
    finally:
        connection.close()


def _trust_anybody() -> ssl.SSLContext:
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return context


def _wait_for_tls(port: int, name: str, process: subprocess.Popen[bytes], log: Path) -> None:
    """Wait until a handshake works; what the program said is in the error where none does."""
    context = _trust_anybody()
    until = time.monotonic() + START_S
    while time.monotonic() < until and process.poll() is None:
        with (
            contextlib.suppress(OSError),
            socket.create_connection(("127.0.0.1", port), timeout=1.0) as plain,
            context.wrap_socket(plain, server_hostname=name),
        ):
            return
        time.sleep(0.05)
    raise AssertionError(f"{process.args} does not listen on {port}: {log.read_text(errors='replace')[-2000:]}")


def _free_port() -> int:
    """A port on which nothing listens, of those that no outgoing connection is given meanwhile."""
    while True:
        port = random.randrange(12_000, 30_000)
        with contextlib.suppress(OSError), socket.socket() as found:
            found.bind(("", port))
            return port


def _find(program: str) -> str | None:
    """Where a program is; those of an administrator are often not in the path of others."""
    return shutil.which(program, path=f"{os.environ.get('PATH', os.defpath)}:/usr/sbin:/usr/local/sbin")
