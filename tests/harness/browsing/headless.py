"""A headless Chromium, spoken to over a pipe: what a page does in a browser, and how long it takes."""

import itertools
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
_FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--remote-debugging-pipe")
_PATIENCE_S = 60.0


class Tab:
    """One page in a browser: `said` holds what it wrote to its console as an error, `asked` what it asked a network."""

    def __init__(self, to_browser: int, from_browser: int):
        self.said: list[str] = []
        self.asked: list[str] = []
        self._to, self._from, self._buffer = to_browser, from_browser, b""
        self._numbers, self._session, self._events = itertools.count(1), "", []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Ask for something and wait for the answer."""
        number = next(self._numbers)
        session = {"sessionId": self._session} if self._session else {}
        os.write(self._to, json.dumps({"id": number, "method": method, "params": params, **session}).encode() + b"\0")
        while (message := self._read()).get("id") != number:
            self._notice(message)
        assert "error" not in message, message
        return message["result"]

    def open(self, url: str) -> float:
        """Open a page; how long it takes until it is loaded [s]."""
        self._events.clear()
        begun = time.perf_counter()
        self.call("Page.navigate", url=url)
        while "Page.loadEventFired" not in self._events:
            self._notice(self._read())
        return time.perf_counter() - begun

    def evaluate(self, expression: str) -> Any:
        """The value of an expression in the page."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait_for(self, expression: str) -> None:
        """Wait until an expression in the page is true."""
        until = time.perf_counter() + _PATIENCE_S
        while not self.evaluate(expression):
            assert time.perf_counter() < until, f"never true: {expression}"
            time.sleep(0.01)

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            assert select.select([self._from], [], [], _PATIENCE_S)[0], "the browser is silent"
            part = os.read(self._from, 1 << 20)
            assert part, "the browser has ended"
            self._buffer += part
        message, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(message)

    def _notice(self, message: dict[str, Any]) -> None:
        method, params = message.get("method", ""), message.get("params", {})
        self._events.append(method)
        if method == "Runtime.exceptionThrown":
            self.said.append(params["exceptionDetails"].get("exception", {}).get("description", "an exception"))
        elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
            self.said.append(f"{params['type']}: {[each.get('value') for each in params['args']]}")
        elif method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            self.said.append(params["entry"]["text"])
        elif method == "Network.requestWillBeSent":
            url = params["request"]["url"]
            if not url.startswith(("file:", "data:", "blob:", "about:")):
                self.asked.append(url)


@contextmanager
def open_browser(width: int = 1280, height: int = 900) -> Iterator[Tab]:
    """A browser of its own with one tab; it is ended with the context."""
    assert CHROMIUM, "no Chromium was found"
    out_read, out_write = os.pipe()
    in_read, in_write = os.pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        browser = subprocess.Popen(
            # Chromium reads from file 3 and writes to file 4.
            ["bash", "-c", 'exec "$@" 3<&"$0" 4>&"$ANSWERS"', str(in_read), CHROMIUM, *_FLAGS]
            + [f"--window-size={width},{height}", f"--user-data-dir={profile}"],
            pass_fds=(in_read, out_write),
            env={**os.environ, "ANSWERS": str(out_write)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(in_read)
        os.close(out_write)
        try:
            yield Tab(in_write, out_read)
        finally:
            browser.terminate()
            browser.wait(10)
            os.close(in_write)
            os.close(out_read)
