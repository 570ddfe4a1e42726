"""Holds the settings of a program against their schema by jsonschema-rs: settings_schema.py PORT, that of the web interface."""

import copy
import json
import sys
import time
import urllib.error
import urllib.request

import jsonschema_rs


class Interface:
    def __init__(self, port: str) -> None:
        self.base = f"http://127.0.0.1:{port}/api/v1/"
        self.headers = {"Content-Type": "application/json"}

    def call(self, path: str, body=None):
        data = body if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.base + path, data=data, headers=self.headers)
        with urllib.request.urlopen(request, timeout=10) as response:
            return json.load(response)

    def log_in(self) -> None:
        end = time.monotonic() + 30
        while True:
            try:
                session = self.call("session", {"user": "anna", "password": "let me in", "token": True})
                break
            # The interface is there soon after the program has started.
            except urllib.error.URLError:
                if time.monotonic() > end:
                    raise
                time.sleep(0.05)
        self.headers["Authorization"] = f"Bearer {session['token']}"


def main() -> None:
    interface = Interface(sys.argv[1])
    interface.log_in()
    schema, settings = interface.call("settings/schema"), interface.call("settings/json")
    jsonschema_rs.meta.validate(schema)
    validator = jsonschema_rs.Draft202012Validator(schema)
    validator.validate(settings)
    kinds = {port["kind"] for port in settings["port"]}
    assert kinds == {"tcp server", "tcp client", "udp server", "http server", "serial", "scanner"}, kinds
    assert settings.keys() >= {"user", "mdns", "port", "server", "route", "device", "point"}, settings.keys()
    for verb, lines in settings.items():
        for nth, line in enumerate(lines):
            for name, value in line.items():
                wrong = copy.deepcopy(settings)
                wrong[verb][nth][name] = [value]
                assert not validator.is_valid(wrong), (verb, name)
            wrong = copy.deepcopy(settings)
            wrong[verb][nth]["surprise"] = 1
            assert not validator.is_valid(wrong), verb
    print("all fit")


main()
