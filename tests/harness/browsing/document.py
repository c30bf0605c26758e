"""What a page holds, read by the standard library's parser, and the law that it needs no network."""

import json
import re
from functools import cache
from html.parser import HTMLParser

VOID = {"meta", "link", "br", "rect", "line", "input"}


class Document(HTMLParser):
    """What a page holds, read by the standard library's parser; a tag out of place is an error."""

    def __init__(self, html: str):
        super().__init__()
        self.html, self.open, self.tags, self.text = html, [], [], []
        self.feed(html)
        self.close()
        assert not self.open, f"not closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("script", "style"):
            self.text.append(data)
        elif self.open:
            self.tags[-1][1].setdefault("content", data)

    def all(self, tag):
        return [attrs for name, attrs in self.tags if name == tag]

    @property
    def said(self) -> str:
        return " ".join(" ".join(self.text).replace("\u00a0", " ").split())

    @property
    def figures(self) -> list[dict]:
        return [json.loads(each["content"]) for each in self.all("script") if each.get("type") == "application/json"]


@cache
def read(html: str) -> Document:
    return Document(html)


def assert_needs_no_network(html: str, *, library: str = "") -> None:
    """Nothing is loaded, but a library beside the page where one is named; and the browser is told to hold it so."""
    document = read(html)
    assert not [attrs for _, attrs in document.tags if {"src", "srcset", "action", "poster"} & set(attrs)]
    assert [each.get("data-path", "") for each in document.all("script") if each.get("class") == "library"] == [library]
    assert {attrs["href"] for attrs in document.all("link")} == {"data:,"}
    assert not {"img", "iframe", "object", "embed", "base", "video", "audio"} & {tag for tag, _ in document.tags}
    assert all(not re.match(r"[a-z]+:|//", attrs["href"]) for attrs in document.all("a"))
    assert not re.search(r"url\(|@import", " ".join(each["content"] for each in document.all("style")))
    policy = next(each["content"] for each in document.all("meta") if "http-equiv" in each)
    assert "default-src 'none'" in policy
    assert "http" not in policy
    scripts = policy.partition("script-src")[2].partition(";")[0]
    assert "unsafe" not in scripts
    assert ("file:" in scripts) == bool(library)
