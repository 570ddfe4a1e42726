"""Reads the metrics of a program by prometheus_client: metrics.py PORT closed|open FILE.

Writes them to FILE as the text that promtool reads.
"""

import sys
import time
import urllib.error
import urllib.request

from prometheus_client.openmetrics import parser


def get(port: str, accept: str) -> tuple[str, str]:
    request = urllib.request.Request(f"http://127.0.0.1:{port}/metrics", headers={"Accept": accept})
    with urllib.request.urlopen(request, timeout=10) as response:
        return response.headers["Content-Type"], response.read().decode()


def wait(port: str) -> None:
    end = time.monotonic() + 30
    while True:
        try:
            get(port, "text/plain")
            return
        except urllib.error.HTTPError:
            return
        # The interface is there soon after the program has started.
        except urllib.error.URLError:
            if time.monotonic() > end:
                raise
            time.sleep(0.05)


def main() -> None:
    port, state, file = sys.argv[1:]
    wait(port)
    if state == "closed":
        try:
            get(port, "text/plain")
        except urllib.error.HTTPError as error:
            print(f"{error.code} without a log-in")
        return
    kind, text = get(port, "text/plain")
    assert kind.startswith("text/plain; version=0.0.4"), kind
    with open(file, "w", encoding="utf-8") as out:
        out.write(text)
    accept = "application/openmetrics-text;version=1.0.0,text/plain;version=0.0.4;q=0.5"
    kind, text = get(port, accept)
    assert kind.startswith("application/openmetrics-text; version=1.0.0"), kind
    families = list(parser.text_string_to_metric_families(text))
    print(len(families), "families")
    for family in families:
        assert family.documentation, family.name
        for sample in family.samples:
            labels = sample.labels
            if sample.name == "mobgate_port_events_total" and labels["event"] == "requests":
                print(labels["port"], "requests", sample.value)
            if sample.name == "mobgate_unit_up":
                print(labels["port"], labels["unit"], "up" if sample.value else "down")


main()
