//! What `help` says.

use core::str::Lines;

use crate::language::{Words, Wrong};
use crate::scanner::POINTS;
use crate::settings::SERVERS;

/// What stands for the text of a command that a gateway without data points does not have.
const NO_POINTS: &str = "this board has no data points";

/// What stands for the text of a command about servers where a TCP client has one.
const NO_SERVERS: &str = "on this board a tcp client has one server";

/// What a command of data points has to say, where there are any.
const fn of_points(text: &'static str) -> &'static str {
    if POINTS { text } else { NO_POINTS }
}

/// The texts of `help WORD`; `help` is the first line of each. A tabulator parts what is typed from what it does.
const TOPICS: &[(&str, &str)] = &[
    ("help", "help [WORD]\tthis list, or all about a command"),
    (
        "port",
        "port NAME serial|tcp|udp|... \ta port: a new one, or another one in place of the port of that name
port NAME serial DEVICE rtu|ascii client|server [BAUD] [FORMAT] [OPTION VALUE]...
port NAME tcp|udp server [ADDRESS:]PORT [OPTION VALUE]...
port NAME tcp client ADDRESS[:PORT] [OPTION VALUE]...\tof one server; without an address server lines say which
port NAME scanner\tasks the devices of data points, by the rules for its name
port NAME ethercat [interface NAME] [line PORT] [on-loss hold|clear|stop] [id N|alias] [modules|no-modules] [emergencies|no-emergencies] [prove-outputs|no-prove-outputs]
\tasks the devices of the EtherCAT process image; interface: on Linux, the network interface where a
\tMainDevice finds the gateway
  serial: 19200 8E1 (ascii 7E1), gap T|auto, char-timeout T|auto, echo|no-echo, rs232|rs485|rts;
          with rs485 or rts: driver-before T, driver-after T
  client: timeout T, retries N, turnaround T, start-delay T, late-window T|auto, down-after N
  server: answer-within T, reply-delay T
  tcp client: rtu, in-flight N, unit N (one server), sockets N (several: connections at a time), timeout T, connect-timeout T, connect-delay T, request-delay T, idle T,
          retries N, late-window T|auto, down-after N;  udp: pipeline N, requests N, lifetime T, allow
  tcp server: rtu, clients N, idle T, pipeline N, lifetime T, full displace|refuse, reserve N for PREFIX[,PREFIX]...,
          allow PREFIX,...|*,
          capture: frames for Wireshark instead of answers
  servers: broadcast|unit-255|reserved-units rules|off|local|replace N, broadcast all, confirm-broadcast
  A time T has its unit: 750us, 1.75ms, 300ms, 1s, 2m.
  port P1 serial uart1 rtu client 19200 8E1 timeout 300ms",
    ),
    (
        "server",
        match SERVERS {
            true => {
                "server PORT unit UNITS at ADDRESS[:PORT] [tag TAG]\ta server behind a tcp client without an address
  UNITS: 7 or 1-5, those it is asked for; no unit is in two servers of a port, one in none gets 0A
  ADDRESS: 192.168.1.20 or a name, which is looked up whenever a connection is opened; PORT: 502
  TAG: what the server itself calls the unit: =1, or +N or -N for several; as in route
  server plant unit 1-5 at 192.168.1.20:502
  server plant unit 7 at meter.example tag =1"
            }
            false => NO_SERVERS,
        },
    ),
    (
        "route",
        "route SOURCE UNITS IP TAG DESTINATION [OPTION]...\ta rule behind the others; the first one that fits decides
  OPTION: readonly|all|functions LIST, addresses RANGE, writes RANGE, forbidden refuse|ignore,
          priority high|normal|low, urgent LIST, merge on|off|adjacent|near N, cache T, cut auto|on|off
  UNITS: 7, 1-64 or *    IP: address, prefix or *    TAG: * keeps the unit, +N or -N shifts it, =N sets it
  DESTINATION: a port, local, discard (no answer) or nopath (exception 0Ah)
  LIST: 3,4,16 or 1-6; 43/14 is the device identification alone. What names no addresses passes no addresses RANGE,
  what may write anywhere (8, 21, 43, unknown) no writes RANGE. ignore: 5, 6, 15, 16 are answered as if done
  merge on: identical reads that wait are one transaction; adjacent: also those that touch; near N: or are N apart
  route P502 101-132 192.168.1.0/24 -100 P3 readonly priority high",
    ),
    (
        "device",
        of_points(
            "device NAME unit N [OPTION]...\ta device that the scanner asks
  OPTION: order 0123|2301|1032|3210: of the bytes of values of 32 bits; check: asks for a sign of life first; label \"TEXT\"",
        ),
    ),
    (
        "point",
        of_points(
            "point NAME DEVICE|local ...\tties cells of a device, or of the gateway's own unit, to a variable
point NAME DEVICE coil|discrete|input|holding ADDRESS [count N] [as u16|i16|u32|i32|f32] [bit N]
      [label \"TEXT\"] [read low|normal|high|manual|T] [write auto|change|manual] [multiple]
point NAME local coil|discrete|input|holding ADDRESS [count N] [as TYPE] | [of POINT]  [quality ADDRESS]
  as, of coils and discrete inputs: 16 or 32 of them are a number, the first its lowest bit; count is that of bits
  bit: one bit of a register, from 0; written by function 22, or read, changed and written where that is unknown
  ADDRESS is as it is on the wire; a number without a table is Modicon's: 40001 is holding 0.
  read: every 5s, 1s, 200ms, or T; write auto: whenever the variable is written, change: when its value changes
  of: shows the variable of another point; quality: input registers with its status word and age in 0.1s
  point lamps meter coil 16 count 16 as u16
  point run meter holding 40 bit 3 write change
  point power meter holding 0 count 2 as f32 read high label \"Active power\"",
        ),
    ),
    (
        "slave",
        of_points(
            "slave N unit U ...\ta device behind the EtherCAT process image
slave N unit U [coil|discrete ADDRESS [count N]]... [input|holding ADDRESS [count N]
  [as u16|i16|u32|i32|f32]]... [order 0123|2301|1032|3210] [read T] [check]
      [on-silence hold|clear|substitute VALUE]
  As a MainDevice configures it too; N from 0, in the order of their values.
  read: every T, else every 1s; check: asks for a sign of life first; on-silence: what its inputs become when it
  does not answer any more: they stay, are 0, or each register is VALUE and each bit its lowest one
  slave 0 unit 232 coil 10 count 18 holding 40010 count 4 read 100ms on-silence clear",
        ),
    ),
    (
        "edit",
        "edit port NAME WORD...\tchanges what the words name, as in port; the rest stays
edit route N SOURCE UNITS ...\tputs another rule in place of rule N, as in route",
    ),
    ("insert", "insert route N SOURCE UNITS ...\tputs a rule before rule N, as in route"),
    ("move", "move route N M\tmakes rule N the rule M"),
    (
        "delete",
        "delete port NAME\ttakes a port away that no rule names
delete server PORT unit UNITS\ttakes a server away
delete route N\ttakes rule N away
delete routes\ttakes all rules away
delete device NAME, delete point NAME, delete slave N, delete slaves",
    ),
    (
        "network",
        "network dhcp|address ...\tthe address of a board with an Ethernet of its own; takes effect at once
network dhcp [name NAME]\tit is a DHCP server's to give
network address ADDRESS/PREFIX [gateway ADDRESS] [dns ADDRESS]\tdns: who is asked for names of servers
  network address 192.168.1.5/24",
    ),
    (
        "mdns",
        "mdns on [name NAME]\tthe gateway's Modbus TCP servers are found on the network (multicast DNS, _modbus._tcp)
\tunder this name, else under the one of network dhcp or the machine's
mdns off\tit does not answer",
    ),
    (
        "show",
        "show TOPIC\tports, servers, routes, units, clients, stats, log, frames, points, devices, registers, config, network, version
show ports\twhat the ports are and how they do
show servers\tthe servers of tcp clients that have several, and how they do
show routes\tthe rules by number; an implied one is the way back of another
show units\tthe devices behind the ports: whether they answer, how fast, and their troubles
show clients\twho is connected
show stats\twhat the ports counted, and how often in a minute since clear stats
show log\tthe last transactions
show frames\tthe last frames of the serial lines, as they were on the wire, and of networks
\tif somebody watched or captured
show points\tthe data points: how they are doing, and their values
show devices\tthe devices that the scanner asks
show registers\tthe registers of the gateway's own unit, where a rule leads to local
show config\tthe settings as lines that make them
show network\tthe board's own address
show version\twhat runs here, for how long, and whether an EtherCAT controller answers, and what its RUN and ERR lights show",
    ),
    (
        "ping",
        "ping UNIT via PORT\tasks a unit for a sign of life (function 8), and says how long that took",
    ),
    (
        "scan",
        "scan PORT [OPTION]...\tfinds the units on a serial client's line, and their speed and format
  OPTION: BAUD, units A-B, timeout T, function N
  At each speed it tries 8E1, 8N1, 8O1 and 8N2 (ascii: 7E1, 7N2, 7O1, 8N1).
  Without words: 9600 19200 38400 57600 115200 4800 2400 1200, units 1-247, 60ms and some characters, function 3.
  A key or a line stops it. Meanwhile others who ask by the port get 0A; behind it the port is as before.
  scan P1 9600 19200 units 1-32",
    ),
    (
        "tune",
        "tune PORT [units A-B] [count N]\tmeasures how long units take to answer, and proposes time-out and gap
  Asks each unit N times (2000), those that have answered so far unless some are named, with a time-out of 3s.
  Other traffic goes on. A key or a line stops it; behind it the port is as before.",
    ),
    (
        "read",
        "read UNIT|POINT ...\treads at once, and shows the values
read POINT
read UNIT coil|discrete|input|holding ADDRESS [count N] [as u16|i16|u32|i32|f32] [order 0123|...] via PORT",
    ),
    (
        "write",
        "write UNIT|POINT ...\twrites at once
write POINT [[at N] VALUE...]\tsets its values, from value N on; between begin and finish they are only set
write UNIT coil|holding ADDRESS [as TYPE] [order 0123|...] VALUE... via PORT",
    ),
    (
        "mark",
        of_points(
            "mark DEVICE FUNCTION FROM-TO\treads (1 to 4) or writes (5, 6, 15, 16) all points there at once",
        ),
    ),
    (
        "begin",
        of_points(
            "begin POINT\tbegins a safe write: it is neither read nor written until finish
  It ends without a write when nothing is set for 60s.",
        ),
    ),
    ("finish", of_points("finish POINT\tends a safe write: the point is written")),
    (
        "clear",
        "clear stats\tsets counters to zero, those of units too
clear log\tforgets the transactions",
    ),
    (
        "capture",
        "capture FILE\twrites frames into a new file as they come (PCAPNG, for Wireshark); on Linux
capture off\tends that
  Over the network, on boards too: port wire tcp server 5029 capture, then nc BOARD 5029 | wireshark -k -i -",
    ),
    (
        "watch",
        "watch\tshows frames of all ports as they come, until a key or a line
watch points\tshows data points whose status or values change, likewise",
    ),
    (
        "save",
        "save\tkeeps the settings for the next start; till then the prompt is mobgate*>
save force\talso where the file was edited since it was read",
    ),
    ("load", "load\ttakes the saved settings back"),
    ("reboot", "reboot\tstarts again with the saved settings"),
    ("exit", "exit\tends this session"),
];

/// What is left to say.
#[derive(Debug, Clone)]
pub(super) enum Help {
    /// The first lines of these topics.
    Overview(&'static [(&'static str, &'static str)]),
    /// These lines.
    Topic(Lines<'static>),
}

impl Help {
    /// The text for the rest of a line that began with `help`.
    pub(super) fn parse(words: &Words) -> Result<Self, Wrong> {
        if words.peek().is_end() {
            return Ok(Self::Overview(TOPICS));
        }
        let text = words.take().keyword(TOPICS, "a command (see help)")?;
        words.end()?;
        Ok(Self::Topic(text.lines()))
    }

    /// The next line: what is typed, and what it does.
    pub(super) fn next(&mut self) -> Option<(&'static str, &'static str)> {
        let line = match self {
            Self::Topic(lines) => lines.next()?,
            Self::Overview(topics) => loop {
                let ((_, text), behind) = topics.split_first()?;
                *topics = behind;
                if *text != NO_POINTS && *text != NO_SERVERS {
                    break text.lines().next()?;
                }
            },
        };
        Some(line.split_once('\t').unwrap_or((line, "")))
    }
}

#[cfg(test)]
mod tests {
    use super::super::command::COMMANDS;
    use super::*;

    #[test]
    fn every_command_has_its_help() {
        for (command, _) in COMMANDS {
            assert!(TOPICS.iter().any(|(topic, text)| topic == command
                && (text.starts_with(command) || [NO_POINTS, NO_SERVERS].contains(text))));
        }
        assert_eq!(TOPICS.len(), COMMANDS.len());
    }

    #[test]
    fn the_overview_says_of_every_command_what_it_does() {
        let mut overview = Help::Overview(TOPICS);
        while let Some((typed, does)) = overview.next() {
            assert!(!does.is_empty(), "{typed}");
        }
    }
}
