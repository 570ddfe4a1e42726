"""Uses the web interface by HTTPS: https.py PORT FOLDER none|NAME, of a client's certificate in the folder."""

import http.client
import json
import socket
import ssl
import sys
import time


def call(port: int, context: ssl.SSLContext, method: str, path: str, headers: dict, body=None):
    end = time.monotonic() + 30
    while True:
        connection = http.client.HTTPSConnection("127.0.0.1", port, context=context, timeout=10)
        try:
            connection.request(method, path, body, headers)
            response = connection.getresponse()
            response.body = response.read()
            return response
        # The interface is there soon after the program has started.
        except ConnectionRefusedError:
            if time.monotonic() > end:
                raise
            time.sleep(0.05)
        finally:
            connection.close()


def main() -> None:
    port, folder, name = int(sys.argv[1]), sys.argv[2], sys.argv[3]
    context = ssl.create_default_context(cafile=f"{folder}/plant.pem")
    if name != "none":
        context.load_cert_chain(f"{folder}/{name}.pem", f"{folder}/{name}.key")
    origin = f"https://127.0.0.1:{port}"
    body = json.dumps({"user": "anna", "password": "let me in"})
    as_json = {"Content-Type": "application/json", "Origin": origin}
    session = call(port, context, "POST", "/api/v1/session", as_json, body)
    assert session.status == 200, session.body
    cookie, attributes = session.headers["Set-Cookie"].split("; ", 1)
    print("logged in:", attributes)
    print("status:", call(port, context, "GET", "/api/v1/status", {"Cookie": cookie}).status)
    foreign = {"Cookie": cookie, "Origin": f"http://127.0.0.1:{port}"}
    print("other origin:", call(port, context, "DELETE", "/api/v1/session", foreign).status)
    print("log-out:", call(port, context, "DELETE", "/api/v1/session", {"Cookie": cookie, "Origin": origin}).status)
    with socket.create_connection(("127.0.0.1", port), timeout=10) as plain:
        plain.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        print("cleartext:", "HTTP" if b"HTTP" in plain.recv(100) else "no response")


main()
