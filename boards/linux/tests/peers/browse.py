"""Looks for Modbus TCP servers by multicast DNS, as an engineer's tool does: browse.py ADDRESS. Looks in the network of that address
of this machine, and prints a line when a server comes, changes or goes, until its standard input ends.
"""

import socket
import sys

from zeroconf import ServiceBrowser, ServiceListener, Zeroconf

KIND = "_modbus._tcp.local."


class Printer(ServiceListener):
    def add_service(self, zeroconf, kind, name):
        info = zeroconf.get_service_info(kind, name)
        addresses = [socket.inet_ntoa(address) for address in info.addresses]
        product = info.properties[b"product"].decode()
        say("found", name.removesuffix("." + KIND), *addresses, info.port, info.server, product)

    def remove_service(self, zeroconf, kind, name):
        say("gone", name.removesuffix("." + KIND))

    update_service = add_service


def say(*words):
    print(*words, flush=True)


zeroconf = Zeroconf(interfaces=[sys.argv[1]])
browser = ServiceBrowser(zeroconf, KIND, Printer())
sys.stdin.read()
browser.cancel()
zeroconf.close()
