//! The help texts of lines whose options depend on the image.

/// The text of a line of help, if the image has the feature; otherwise nothing.
macro_rules! help_with {
    ($feature:literal, $name:ident: $text:literal) => {
        #[cfg(feature = $feature)]
        macro_rules! $name {
            () => {
                $text
            };
        }
        // As above.
        #[cfg(not(feature = $feature))]
        macro_rules! $name {
            () => {
                ""
            };
        }
    };
}
help_with!("web", http_help: "port NAME http server [ADDRESS:]PORT [OPTION]...\tthe web interface\n");
help_with!("web", http_options: "  http server: allow PREFIX,...|*, cleartext (log in from other machines),
              metrics (without a log-in)\n");
help_with!("tls", role_option: "role NAME (in the certificates of clients),\n          ");
help_with!("tls", tls_options: "  tls:        of tcp and http servers, and tcp clients: tls,
              certificate NAME|none (own), trust NAME|none: see help certificate
");
help_with!("servers", servers_help: "port NAME tcp client [OPTION]...\tmany servers: see help server\n");
help_with!("servers", servers_options: "    many servers: sockets N (connections at a time)\n");
help_with!("servers", delete_server_help: "delete server PORT unit UNITS\n");
help_with!(
    "points",
    points_help: "port NAME scanner\tpolls the devices of data points, by the
\trules for its name
port NAME ethercat [OPTION]...\tthe gateway as an EtherCAT SubDevice
"
);
help_with!(
    "points",
    ethercat_options: "  ethercat:   interface NAME (on Linux: where a MainDevice is),
              line PORT, on-loss hold|clear|stop, id N|alias,
              modules|no-modules, emergencies|no-emergencies,
              prove-outputs|no-prove-outputs
"
);
help_with!(
    "points",
    delete_points_help: "delete device NAME
delete point NAME
delete slave N
delete slaves\tall of them
"
);
help_with!("users", delete_user_help: "delete user NAME\n");
help_with!("tls", delete_certificate_help: "delete certificate NAME\n");
help_with!("ssh", ssh_help: "port NAME ssh server [ADDRESS:]PORT [OPTION]...\tthe console by SSH\n");

pub(super) const PORT: &str = concat!(
    "port NAME KIND ...\tadds a port, or replaces the one of that name
port NAME serial DEVICE rtu|ascii client|server [BAUD] [FORMAT] [OPTION]...
port NAME tcp|udp server [ADDRESS:]PORT [OPTION]...
port NAME tcp client ADDRESS[:PORT] [OPTION]...\tone server
",
    servers_help!(),
    http_help!(),
    ssh_help!(),
    points_help!(),
    "  serial:     19200 8E1 (ascii 7E1), gap T|auto, char-timeout T|auto,
              echo|no-echo, rs232|rs485|rts;
              with rs485 or rts: driver-before T, driver-after T
    client:   timeout T, retries N, turnaround T, start-delay T,
              late-window T|auto, down-after N, proof ...
    server:   answer-within T, reply-delay T
  tcp client: rtu, in-flight N, timeout T, connect-timeout T, connect-delay T,
              request-delay T, idle T, retries N, late-window T|auto,
              down-after N
    one server: unit N
",
    servers_options!(),
    "  tcp server: rtu, clients N, idle T, pipeline N, lifetime T,
              full displace|refuse, reserve N for PREFIX[,PREFIX]...,
              allow PREFIX,...|*; capture: frames for Wireshark
  udp server: pipeline N, requests N, lifetime T, allow PREFIX,...|*
  servers:    broadcast|unit-255|reserved-units rules|off|local|replace N,
              broadcast all, confirm-broadcast
",
    http_options!(),
    tls_options!(),
    ethercat_options!(),
    "  A time T has its unit: 750us, 1.75ms, 300ms, 1s, 2m.
  port P1 serial uart1 rtu client 19200 8E1 timeout 300ms"
);

pub(super) const ROUTE: &str = concat!(
    "route SOURCE UNITS IP TAG ...\tadds a rule; the first that matches decides
route SOURCE UNITS IP TAG DESTINATION [OPTION]...
  SOURCE: a port       UNITS: 7, 1-64 or *       IP: address, prefix or *
  TAG: * keeps the unit id, +N or -N shifts it, =N sets it
  DESTINATION: a port, local, discard (no response) or nopath (exception 0A)
  OPTION: ",
    role_option!(),
    "readonly|all|functions LIST, addresses RANGE, writes RANGE,
          forbidden refuse|ignore, priority high|normal|low, urgent LIST,
          merge on|off|adjacent|near N, cache T, cut auto|on|off
  LIST: 3,4,16 or 1-6; 43/14 is the device identification alone.
  addresses refuses what names no addresses, writes refuses what may write
  anywhere (8, 21, 43, unknown); ignore answers 5, 6, 15, 16 as if done.
  merge on: identical reads that wait are one transaction; adjacent: also
  those that touch; near N: also those at most N addresses apart.
  route P502 101-132 192.168.1.0/24 -100 P3 readonly priority high"
);

pub(super) const DELETE: &str = concat!(
    "delete port NAME\tremoves a line of the settings
delete port NAME\ta port that no rule names
",
    delete_server_help!(),
    "delete route N
delete routes\tall rules
",
    delete_points_help!(),
    delete_certificate_help!(),
    delete_user_help!(),
);
