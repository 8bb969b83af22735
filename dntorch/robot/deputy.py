"""A process of its own that stops the robot when this one can not: held up, suspended or dead.

Threads do not do: who holds the interpreter's lock (a call into C that does not give it back)
holds up all of them, and SIGSTOP or SIGKILL end whatever they had in mind. The deputy has a copy
of the link's descriptor and the bytes of a stop. It hears a byte whenever wheels are set in
motion; when none follows in time, or when the pipe breaks because its owner has died, it writes
the stop. This file is also its program, so it imports nothing that is slow.
"""

import os
import select
import signal
import sys
import time

MOVES, STANDS, BYE = b"m", b"s", b"b"

#: s for which the deputy of a dead owner tries to write, and takes what the robot still sends: a
#: link that is closed with bytes unread is reset, and a stop on its way may be lost with it.
LAST = 1.0


class Deputy:
    """Watches over one link, until `dismiss`.

    Args:
        descriptor: of the link, a socket or a serial line.
        limit: s without a word after which it writes ``stop``, if the robot moves.
        stop: bytes.

    Raises:
        OSError: the process cannot be started.
    """

    def __init__(self, descriptor: int, limit: float, stop: bytes) -> None:
        import fcntl  # not on Windows
        import subprocess  # the program of the deputy does without

        if not sys.executable:
            raise OSError("no Python to start: the process that stops the robot needs one")
        link = fcntl.fcntl(descriptor, fcntl.F_DUPFD, 3)  # not 0 to 2, which are the child's own
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", __file__, str(link), str(limit), stop.hex()],
                stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                pass_fds=[link], cwd="/",
                start_new_session=True,  # what ends or suspends a whole terminal spares it
            )  # fmt: skip
        finally:
            os.close(link)
        self._pipe = self._process.stdin.fileno()
        os.set_blocking(self._pipe, False)

    def hear(self, moves: bool) -> bool:
        """Tell it that the loop is alive; false if the deputy is not."""
        try:
            os.write(self._pipe, MOVES if moves else STANDS)
        except BlockingIOError:
            pass  # it has enough to read
        except OSError:
            return False
        return True

    def dismiss(self) -> None:
        """End it without a stop."""
        try:
            os.write(self._pipe, BYE)
        except OSError:
            pass
        self._process.stdin.close()
        import subprocess

        try:
            self._process.wait(LAST)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def serve(link: int, limit: float, stop: bytes) -> None:
    """The program of the deputy; its owner is at the other end of standard input."""
    due, rest = None, stop
    while True:
        left = None if due is None else max(0.0, due - time.monotonic())
        if select.select([0], [], [], left)[0]:
            words = os.read(0, 4096)
            if words.endswith(BYE):
                return
            if not words:
                break
            due = time.monotonic() + limit if words.endswith(MOVES) else None
        else:
            rest = write(link, rest)  # where there is no room now, the rest follows soon
            due, rest = (time.monotonic() + limit / 10, rest) if rest else (None, stop)
    write(link, rest, LAST)
    drain(link, LAST)


def write(link: int, data: bytes, patience: float = 0.0) -> bytes:
    """What is left of ``data``: nothing when all has left, or the link is gone."""
    end = time.monotonic() + patience
    while data:
        try:
            data = data[os.write(link, data) :]
        except BlockingIOError:
            if time.monotonic() > end:
                break
            select.select([], [link], [], max(0.0, end - time.monotonic()))
        except OSError:
            return b""
    return data


def drain(link: int, patience: float) -> None:
    """Take what comes for a while."""
    end = time.monotonic() + patience
    try:
        while (left := end - time.monotonic()) > 0:
            if select.select([link], [], [], left)[0] and not os.read(link, 1 << 16):
                return
    except OSError:
        pass


if __name__ == "__main__":
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP"):
        signal.signal(getattr(signal, name), signal.SIG_IGN)  # it ends with its owner
    serve(int(sys.argv[1]), float(sys.argv[2]), bytes.fromhex(sys.argv[3]))
