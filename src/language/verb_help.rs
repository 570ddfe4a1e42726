//! The help texts of lines whose options depend on the image: parts whose feature it lacks are left out.

use super::listed::joined;
use super::port_kinds::{HELP, HELP_OPTIONS};
use crate::scanner::LONG_VALUES;

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

pub(super) const POINT: &str = joined!(&[
    "point NAME DEVICE|local ...\tties registers or coils to a variable
point NAME DEVICE coil|discrete|input|holding ADDRESS [OPTION]...
  OPTION: count N, as u16|i16|u32|i32|f32, bit N, label \"TEXT\",
          read low|normal|high|manual|T, write auto|change|manual, multiple
",
    #[cfg(feature = "long-values")]
    "          as u64|i64|f64|text N, bits N-M, scale X, offset X, write every T
",
    "point NAME local coil|discrete|input|holding ADDRESS [OPTION]...
  OPTION: count N, as TYPE, of POINT, quality ADDRESS
  ADDRESS: as it is on the wire, or Modicon's: 40001 is holding 0.
  as, of coils and discrete inputs: 16 or 32 of them are a number, the first
  its lowest bit; count is that of the bits.
  bit: one bit of a register, from 0; written by function 22, or read,
  changed and written where the device does not know that.
",
    #[cfg(feature = "long-values")]
    "  bits: those from N to M are a number, written likewise.
  text N: characters in N registers; scale, offset: a value is its raw
  number times the scale plus the offset.
  write every: whenever the variable is written, and from then on its last
  value each T, for devices with a watchdog.
",
    "  read: every 5s, 1s, 200ms, or T; write auto: whenever the variable is
  written, change: when its value changes.
  of: shows the variable of another point; quality: input registers with its
  status word and age in 0.1s.
  point lamps meter coil 16 count 16 as u16
  point run meter holding 40 bit 3 write change
  point power meter holding 0 count 2 as f32 read high label \"Power\"",
    #[cfg(feature = "long-values")]
    "
  point total meter holding 10 as u64
  point serial meter holding 100 as text 8
  point celsius meter input 5 as i16 scale 0.1 offset -40",
]);

pub(super) const SLAVE: &str = joined!(&[
    "slave N unit U ...\ta device in the EtherCAT process image
slave N unit U [coil|discrete ADDRESS [count N]]... [OPTION]...
slave N unit U [input|holding ADDRESS [count N] [as TYPE]]... [OPTION]...
  N: from 0, in the order of their values. A MainDevice configures it, too.
",
    if LONG_VALUES {
        "  TYPE: u16, i16, u32, i32, f32, u64, i64 or f64\n"
    } else {
        "  TYPE: u16, i16, u32, i32 or f32\n"
    },
    "  OPTION: order 0123|2301|1032|3210, read T (else every 1s),
          check: a function 8 goes before each poll,
          on-silence hold|clear|substitute VALUE: what its inputs become
          when it does not respond any more: they stay, are 0, or each
          register is VALUE and each bit its lowest one
  slave 0 unit 232 coil 10 count 18 holding 40010 count 4 on-silence clear",
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
          every T, format json|homeassistant|sparkplug, commands on|off",
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
