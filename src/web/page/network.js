// Network: addresses, the sockets of ports, and what else uses the network.

import { get } from "./api.js";
import { h, lamp, table } from "./dom.js";
import { app, isOpen, redraw } from "./state.js";
import { T } from "./texts.js";

let own = [];
let serviceLines = {};

async function loadNetwork() {
  [own, serviceLines] = await Promise.all([get("network").then((response) => response.network), get("settings/json")]);
  redraw();
}

/// Services with what the settings say of them.
function services() {
  const [network, mdns, ntp, syslog] = ["network", "mdns", "ntp", "syslog"].map((verb) => serviceLines[verb]?.[0]);
  const named = own.length ? network?.dns || T.network.dnsNone : T.network.dnsOfOs;
  return [
    [T.network.dns, named],
    [T.network.mdns, mdns?.state === "off" ? T.network.off : T.network.mdnsOn(mdns?.name)],
    [T.network.ntp, ntp?.server || T.network.off],
    [T.network.syslog, syslog ? `${syslog.transport} ${syslog.server}` : T.network.off],
  ];
}

const socketLamp = (port) => lamp(isOpen(port) ? "up" : "down", port.status);

export const network = {
  id: "network",
  load: loadNetwork,
  every: 5000,
  draw: () => [
    h("h1", null, T.nav.network), h("h2", null, T.network.own),
    own.length ? table(T.network.own, [T.network.link, T.network.address, T.network.gateway, T.network.ethernet, T.network.setting],
      own.map((row) => ({ cells: [row.link, row.address, row.gateway, row.ethernet, row.setting] }))) : h("p", { class: "quiet" }, T.network.os),
    h("h2", null, T.network.sockets),
    table(T.network.sockets, [T.port, T.network.role, T.network.where, T.network.status], [
      ...app.status.ports.filter((port) => /^(tcp|udp|http|ssh) /.test(port.role)).map((port) => ({ cells: [port.port, [port.role, port.line].filter(Boolean).join(" "), port.where, socketLamp(port)] })),
      ...app.status.servers.map((server) => ({ cells: [`${T.network.server} ${server.port}`, `${T.devices.units} ${server.units}`, server.where, socketLamp(server)] })),
    ], T.network.none),
    h("h2", null, T.network.services),
    table(T.network.services, [T.network.service, T.network.setting], services().map((cells) => ({ cells }))),
  ],
};
