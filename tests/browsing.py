"""Pages in a browser, with what they request and what they complain of, and arrays in their data."""

import base64

import numpy as np


def unpacked(found):
    """Return the numbers of an array in the data of a page, as the hook of `json.loads` for objects."""
    if "packed" not in found:
        return found
    size = int(np.prod(found["shape"]))
    planes = np.frombuffer(base64.b64decode(found["packed"]), np.uint8)
    planes = planes.reshape(len(planes) // max(size, 1), size)
    missing = np.zeros((8 - len(planes), size), np.uint8)
    numbers = np.ascontiguousarray(np.vstack([missing, planes]).T).view("<f8")
    return numbers.reshape(found["shape"])


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
