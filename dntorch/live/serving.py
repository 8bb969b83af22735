"""`dntorch.view`: a page in the browser for a structure, a COSIVINA file or a run."""

import asyncio
import contextlib
import logging
import socket
import threading
import webbrowser
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

import torch

from dntorch.extras import require

if TYPE_CHECKING:
    from dntorch.live.session import Session

TICK = 10
"""ms between two looks whether steps are due"""
ANYWHERE = ("0.0.0.0", "::", "")


class View:
    """A page that is served; made by `view`.

    Attributes:
        url: where it is.
        session: steps the copy of what was given; its methods may be called from any thread.
    """

    def __init__(self, session: "Session", host: str, port: int) -> None:
        self.session, self._host = session, host
        begun: Future[int] = Future()
        self._ended = threading.Event()
        self._stop: Any = None
        self._thread = threading.Thread(
            target=self._serve, args=(host, port, begun), name="dntorch-view", daemon=True
        )
        self._thread.start()
        try:
            self.port = begun.result()
        except OSError as error:
            raise ValueError(
                f"port={port} on host={host}: {error.strerror or error}; name another, or 0 for a "
                "free one"
            ) from error
        shown = "localhost" if host in ANYWHERE else f"[{host}]" if ":" in host else host
        self.url = f"http://{shown}:{self.port}/"

    @property
    def structure(self) -> Any:
        """The copy that is stepped, with all that was changed on the page."""
        return self.session.source.structure

    def stop(self) -> None:
        """Close the page and its server; a second call does nothing."""
        if not self._ended.is_set():
            with contextlib.suppress(RuntimeError):  # it is closed by now
                self._stop()
        self._thread.join(timeout=10)

    def wait(self) -> None:
        """Until `stop` is called elsewhere; Ctrl-C goes through."""
        while not self._ended.wait(0.2):
            pass

    def __repr__(self) -> str:
        return f"View({self.session.source.title!r}, url={self.url!r})"

    # ------------------------------------------------------------------ in the thread

    def _serve(self, host: str, port: int, begun: "Future[int]") -> None:
        from tornado.ioloop import IOLoop

        asyncio.set_event_loop(asyncio.new_event_loop())
        loop = IOLoop.current()
        torch.set_flush_denormal(True)  # of this thread: silent cells stay fast
        try:
            server, port = _server(self.session, host, port, loop)
        except BaseException as error:
            loop.close()
            self._ended.set()
            begun.set_exception(error)
            return
        self._stop = lambda: loop.add_callback(loop.stop)
        try:
            server.start()
            begun.set_result(port)
            loop.start()
        finally:
            with contextlib.suppress(Exception):
                server.stop(wait=False)
            self.session.close()
            self._ended.set()
            with contextlib.suppress(Exception):
                loop.close()


def _server(session: "Session", host: str, port: int, loop: Any) -> tuple[Any, int]:
    from bokeh.application import Application
    from bokeh.application.handlers.function import FunctionHandler
    from bokeh.server.server import BaseServer
    from bokeh.server.tornado import BokehTornado
    from tornado.httpserver import HTTPServer
    from tornado.ioloop import PeriodicCallback

    from dntorch.live.page import Page

    logging.getLogger("bokeh").setLevel(logging.ERROR)
    listening = _listen(host, port)
    port = listening.getsockname()[1]
    pages = 0

    def make(document: Any) -> None:
        nonlocal pages
        Page(session, document)
        pages += 1
        document.on_session_destroyed(gone)

    def gone(_: Any) -> None:
        nonlocal pages
        pages -= 1

    def tick() -> None:
        if pages > 0:
            session.tick()

    names = {host, "localhost", "127.0.0.1"} if host not in ANYWHERE else {"*"}
    origins = [name if name == "*" else f"{name}:{port}" for name in names]
    tornado = BokehTornado(
        {"/": Application(FunctionHandler(make))}, extra_websocket_origins=origins,
        unused_session_lifetime_milliseconds=5_000, check_unused_sessions_milliseconds=2_000,
    )  # fmt: skip
    http = HTTPServer(tornado)
    http.add_sockets([listening])
    PeriodicCallback(tick, TICK).start()
    return BaseServer(loop, tornado, http), port


def _listen(host: str, port: int) -> socket.socket:
    """A socket that listens there; one that can't is closed again.

    Raises:
        OSError: no such address here, or a port that is taken.
    """
    family, *_, address = socket.getaddrinfo(
        host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )[0]
    listening = socket.create_server(address[:2], family=family)
    listening.setblocking(False)
    return listening


def view(
    target: Any, host: str = "127.0.0.1", port: int = 0, browser: bool = True, play: bool = False
) -> View:
    """Open a page in the browser that shows a structure while it runs; does not block.

    The page shows activation, output and input of its parts, a slider for each parameter, kernel
    term and stimulus, and puts an input where somebody clicks. What is stepped is a copy: the
    structure that was given stays as it is.

    Args:
        target: an `Architecture`, a `DNF`, a `NodeWTA`, a `MemoryTrace`; or the path of a COSIVINA
            file, of a run's folder, or of a checkpoint.
        host: address to listen on. Whoever reaches it can use the page.
        port: 0 for a free one.
        browser: open it, too.
        play: begin at once, or wait for the button.

    Returns:
        a `View` with ``url``, ``session``, ``structure`` (the copy), ``stop()``, and ``wait()``
        for the end of a program, which would close the page.

    Raises:
        ImportError: Bokeh is not installed.
        ValueError: a path at which there is nothing to see, a port that is taken, a batch.
        TypeError: something that cannot be viewed.

    >>> from dntorch import DNF, view
    >>> page = view(DNF(50), browser=False)
    >>> name = page.session.touch("field", [20])
    >>> page.session.step(32)
    >>> int(page.session.pictures()["field"].activation.argmax())
    20
    >>> page.stop()
    """
    require("bokeh", "numpy")
    from dntorch.live.session import Session  # with NumPy, which the core does without
    from dntorch.live.sources import open_source

    session = Session(open_source(target))
    try:
        page = View(session, host, port)
    except BaseException:
        session.close()
        raise
    if play:
        session.play()
    if browser:
        webbrowser.open(page.url)
    return page
