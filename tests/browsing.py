"""Pages in a browser, with what they request and what they complain of."""


class Watched:
    """A page in a browser; messages of some kinds in its console are complaints."""

    def __init__(self, page, *kinds):
        self.page = page
        self.requests = []
        self.complaints = []
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on(
            "console",
            lambda m: self.complaints.append(m.text) if m.type in kinds else None,
        )

    def load(self, address):
        """Load an address and wait until it is drawn."""
        self.page.goto("about:blank")
        self.requests.clear()
        self.page.goto(address)
        self.page.wait_for_selector("body[data-state=ready]", timeout=60_000)
