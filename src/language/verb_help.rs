//! The help texts of lines whose options depend on the image: parts whose feature it lacks are left out.

use super::listed::joined;
use super::port_kinds::{HELP, HELP_OPTIONS};

pub(super) const PORT: &str = joined!(&[
    "port NAME KIND ...\tadds a port, or replaces the one of that name\n",
    HELP,
    HELP_OPTIONS,
    "  servers:    broadcast|unit-255|reserved-units rules|off|local|replace N,
              broadcast all, confirm-broadcast
",
    #[cfg(feature = "tls")]
    "  tls:        of tcp and http servers, and tcp clients: tls,
              certificate NAME|none (own), trust NAME|none: see help certificate
",
    "  A time T has its unit: 750us, 1.75ms, 300ms, 1s, 2m.
  port P1 serial uart1 rtu client 19200 8E1 timeout 300ms",
]);

pub(super) const ROUTE: &str = joined!(&[
    "route SOURCE UNITS IP TAG ...\tadds a rule; the first that matches decides
route SOURCE UNITS IP TAG DESTINATION [OPTION]...
  SOURCE: a port       UNITS: 7, 1-64 or *       IP: address, prefix or *
  TAG: * keeps the unit id, +N or -N shifts it, =N sets it
  DESTINATION: a port, local, discard (no response) or nopath (exception 0A)
  OPTION: ",
    #[cfg(feature = "tls")]
    "role NAME (in the certificates of clients),\n          ",
    "readonly|all|functions LIST, addresses RANGE, writes RANGE,
          forbidden refuse|ignore, priority high|normal|low, urgent LIST,
          merge on|off|adjacent|near N, cache T, cut auto|on|off
  LIST: 3,4,16 or 1-6; 43/14 is the device identification alone.
  addresses refuses what names no addresses, writes refuses what may write
  anywhere (8, 21, 43, unknown); ignore answers 5, 6, 15, 16 as if done.
  merge on: identical reads that wait are one transaction; adjacent: also
  those that touch; near N: also those at most N addresses apart.
  route P502 101-132 192.168.1.0/24 -100 P3 readonly priority high",
]);

pub(super) const DELETE: &str = joined!(&[
    "delete port NAME\tremoves a line of the settings
delete port NAME\ta port that no rule names
",
    #[cfg(feature = "servers")]
    "delete server PORT unit UNITS\n",
    "delete route N
delete routes\tall rules
",
    #[cfg(feature = "points")]
    "delete device NAME
delete point NAME
delete slave N
delete slaves\tall of them
",
    #[cfg(feature = "tls")]
    "delete certificate NAME\n",
    #[cfg(feature = "mqtt")]
    "delete publish NAME\n",
    #[cfg(feature = "users")]
    "delete user NAME\n",
]);

/// The help of `publish`.
// As its verb.
#[cfg(feature = "mqtt")]
pub(super) const PUBLISH: &str = joined!(&[
    "publish NAME mqtt broker ADDRESS[:PORT] ...\tdata points by MQTT
publish NAME mqtt broker ADDRESS[:PORT] [OPTION]...
  OPTION: version 3.1.1|5, user NAME, password \"TEXT\", topic PREFIX,
          every T, format json|homeassistant, commands on|off",
    #[cfg(feature = "tls")]
    ",\n          tls, trust NAME, certificate NAME",
    "
  Points go to PREFIX/points/POINT when they change, and every T (60s);
  units that go down or recover to PREFIX/alarms; PREFIX/NAME/status is
  online or offline. PREFIX: mobgate, unless given.
  commands on: a message to PREFIX/points/POINT/set writes the point, and
  the result comes to PREFIX/points/POINT/result.
  PORT: 1883, by TLS 8883. show publishers: how each one does.
  publish plant mqtt broker 192.168.1.9 topic plant/cabinet-7"
]);
