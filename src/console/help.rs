//! What `help` says.

use crate::config::{Words, Wrong};
use crate::scanner::POINTS;

/// What a command of data points has to say, where there are any.
const fn of_points(lines: &'static [&'static str]) -> &'static [&'static str] {
    if POINTS { lines } else { &["this board has no data points"] }
}

/// The texts of `help WORD`.
const TOPICS: &[(&str, &[&str])] = &[
    ("help", &["help [WORD]                      this list, or more about one command"]),
    (
        "port",
        &[
            "port NAME serial DEVICE rtu|ascii client|server [BAUD] [FORMAT] [OPTION VALUE]...",
            "port NAME tcp server [ADDRESS:]PORT [OPTION VALUE]...",
            "port NAME tcp client ADDRESS:PORT [OPTION VALUE]...",
            "port NAME udp server [ADDRESS:]PORT [OPTION VALUE]...",
            "port NAME scanner                asks the devices of data points, by the rules for its name",
            "port NAME ethercat [line PORT] [on-loss hold|clear|stop]",
            "                                 asks the devices of the EtherCAT process image",
            "  A new port, or another one in place of the port of that name.",
            "  serial: 19200 8E1 (ascii 7E1), gap T|auto, char-timeout T|auto, echo|no-echo, rs232|rs485|rts;",
            "          with rs485 or rts: driver-before T, driver-after T",
            "  client: timeout T, retries N, turnaround T, start-delay T, late-window T|auto, down-after N",
            "  server: answer-within T, reply-delay T",
            "  tcp client: rtu, in-flight N, unit N, timeout T, connect-timeout T, connect-delay T, request-delay T, idle T,",
            "          retries N, late-window T|auto, down-after N;  udp: pipeline N, requests N, lifetime T, allow",
            "  tcp server: rtu, clients N, idle T, pipeline N, lifetime T, reserve N for PREFIX[,PREFIX]..., allow PREFIX,...|*,",
            "          capture: frames for Wireshark instead of answers",
            "  servers: broadcast|unit-255|reserved-units rules|off|local|replace N, broadcast all, confirm-broadcast",
            "  A time T has its unit: 750us, 1.75ms, 300ms, 1s, 2m.",
            "  port P1 serial uart1 rtu client 19200 8E1 timeout 300ms",
        ],
    ),
    (
        "route",
        &[
            "route SOURCE UNITS IP TAG DESTINATION [readonly|all|functions LIST] [addresses RANGE] [writes RANGE]",
            "      [priority high|normal|low] [urgent LIST] [merge on|off|adjacent|near N] [cache T] [cut auto|on|off]",
            "  A rule behind the others; the first one that fits a request decides.",
            "  UNITS: 7, 1-64 or *    IP: address, prefix or *    TAG: * keeps the unit, +N or -N shifts it, =N sets it",
            "  DESTINATION: a port, local, discard (no answer) or nopath (exception 0Ah)",
            "  merge on: identical reads that wait are one transaction; adjacent: also those that touch; near N: or are N apart",
            "  route P502 101-132 192.168.1.0/24 -100 P3 readonly priority high",
        ],
    ),
    (
        "device",
        of_points(&[
            "device NAME unit N [order 0123|2301|1032|3210] [check] [label \"TEXT\"]",
            "  A device that the scanner asks; order: of the bytes of values of 32 bits; check: asks for a sign of life first.",
        ]),
    ),
    (
        "point",
        of_points(&[
            "point NAME DEVICE coil|discrete|input|holding ADDRESS [count N] [as u16|i16|u32|i32|f32] [label \"TEXT\"]",
            "      [read low|normal|high|manual|T] [write auto|manual] [multiple]",
            "point NAME local coil|discrete|input|holding ADDRESS [count N] [as TYPE] | [of POINT]  [quality ADDRESS]",
            "  Ties cells of a device, or of the gateway's own unit, to a variable. ADDRESS is as it is on the wire;",
            "  a number without a table is Modicon's: 40001 is holding 0.",
            "  read: every 5s, 1s, 200ms, or T; write auto: whenever the variable is written",
            "  of: shows the variable of another point; quality: input registers with its status word and age in 0.1s",
            "  point power meter holding 0 count 2 as f32 read high label \"Active power\"",
        ]),
    ),
    (
        "slave",
        &[
            "slave N unit U [coil|discrete|input|holding ADDRESS [count N]]... [read T] [check]",
            "      [on-silence hold|clear|substitute VALUE]",
            "  A device behind the EtherCAT process image, as a MainDevice configures it too; N from 0, in the order of their values.",
            "  read: every T, else every 1s; check: asks for a sign of life first; on-silence: what its inputs become when it",
            "  does not answer any more: they stay, are 0, or each register is VALUE and each bit its lowest one",
            "  slave 0 unit 232 coil 10 count 18 holding 40010 count 4 read 100ms on-silence clear",
        ],
    ),
    (
        "edit",
        &[
            "edit port NAME WORD...           changes what the words name, as in port; the rest stays",
            "edit route N SOURCE UNITS IP TAG DESTINATION ...   puts another rule in place of rule N",
        ],
    ),
    ("insert", &["insert route N SOURCE UNITS IP TAG DESTINATION ...   puts a rule before rule N"]),
    ("move", &["move route N M                   makes rule N the rule M"]),
    (
        "delete",
        &[
            "delete port NAME                 takes a port away that no rule names",
            "delete route N                   takes rule N away",
            "delete routes                    takes all rules away",
            "delete device NAME, delete point NAME, delete slave N, delete slaves",
        ],
    ),
    (
        "network",
        &[
            "network dhcp [name NAME]                            the board's address is a DHCP server's to give",
            "network address ADDRESS/PREFIX [gateway ADDRESS]    it is this one",
            "  For boards with an Ethernet of their own; takes effect at once.  network address 192.168.1.5/24",
        ],
    ),
    (
        "show",
        &[
            "show ports                       what the ports are and how they do",
            "show routes                      the rules by number; an implied one is the way back of another",
            "show units                       the devices behind the ports: whether they answer, how fast, and their troubles",
            "show clients                     who is connected",
            "show stats                       what the ports counted, and how often in a minute since clear stats",
            "show log                         the last transactions",
            "show frames                      the last frames of the serial lines, as they were on the wire, and of networks",
            "                                 if somebody watched or captured",
            "show points                      the data points: how they are doing, and their values",
            "show devices                     the devices that the scanner asks",
            "show config                      the settings as lines that make them",
            "show network                     the board's own address",
            "show version                     what runs here, for how long, and whether an EtherCAT controller answers",
        ],
    ),
    (
        "ping",
        &[
            "ping UNIT via PORT               asks a unit for a sign of life (function 8), and says how long that took",
        ],
    ),
    (
        "scan",
        &[
            "scan PORT [BAUD]... [units A-B] [timeout T] [function N]",
            "  Finds the units on a serial client's line, at each speed in 8E1, 8N1, 8O1 and 8N2 (ascii: 7E1, 7N2, 7O1, 8N1).",
            "  Without words: 9600 19200 38400 57600 115200 4800 2400 1200, units 1-247, 60ms and some characters, function 3.",
            "  A key or a line stops it. Meanwhile others who ask by the port get 0A; behind it the port is as before.",
            "  scan P1 9600 19200 units 1-32",
        ],
    ),
    (
        "tune",
        &[
            "tune PORT [units A-B] [count N]   measures how long units take to answer, and proposes time-out and gap",
            "  Asks each unit N times (2000), those that have answered so far unless some are named, with a time-out of 3s.",
            "  Other traffic goes on. A key or a line stops it; behind it the port is as before.",
        ],
    ),
    (
        "read",
        &[
            "read POINT                       reads it at once, and shows its values",
            "read UNIT coil|discrete|input|holding ADDRESS [count N] [as u16|i16|u32|i32|f32] [order 0123|...] via PORT",
        ],
    ),
    (
        "write",
        &[
            "write POINT [[at N] VALUE...]    sets its values, from value N on, and writes it at once",
            "  Between begin and finish the values are only set.",
            "write UNIT coil|holding ADDRESS [as TYPE] [order 0123|...] VALUE... via PORT",
        ],
    ),
    (
        "mark",
        of_points(&[
            "mark DEVICE FUNCTION FROM-TO     reads (1 to 4) or writes (5, 6, 15, 16) all points there at once",
        ]),
    ),
    (
        "begin",
        of_points(&[
            "begin POINT                      begins a safe write: it is neither read nor written until finish",
        ]),
    ),
    ("finish", of_points(&["finish POINT                     ends a safe write: the point is written"])),
    (
        "clear",
        &[
            "clear stats                      sets counters to zero, those of units too",
            "clear log                        forgets the transactions",
        ],
    ),
    (
        "capture",
        &[
            "capture FILE                     writes frames into a new file as they come (PCAPNG, for Wireshark); on Linux",
            "capture off                      ends that",
            "  Over the network, on boards too: port wire tcp server 5029 capture, then nc BOARD 5029 | wireshark -k -i -",
        ],
    ),
    (
        "watch",
        &[
            "watch                            shows frames of all ports as they come, until a key or a line",
            "watch points                     shows data points whose status or values change, likewise",
        ],
    ),
    ("save", &["save                             keeps the settings for the next start"]),
    ("load", &["load                             takes the saved settings back"]),
    ("reboot", &["reboot                           starts again with the saved settings"]),
    ("exit", &["exit                             ends this session"]),
];

const OVERVIEW: &[&str] = &[
    "port NAME serial|tcp ...         sets a port                  help port",
    "route SOURCE UNITS IP TAG DEST   adds a rule                  help route",
    "device, point                    sets data points             help device, help point",
    "slave                            sets the EtherCAT image      help slave",
    "read, write, mark, begin, finish data points at once",
    "edit port|route ...              changes a port or a rule     help edit",
    "insert route, move route         order of rules               help insert",
    "delete port|route|device|point|slave  takes away              help delete",
    "network dhcp|address ...         the board's own address       help network",
    "show TOPIC                       ports, routes, units, clients, stats, points, devices, config, network, log, frames, version",
    "ping, read, write UNIT ... via PORT  asks a unit at once     help read",
    "scan PORT                        finds units, and their speed and format                help scan",
    "tune PORT                        measures answer times, and proposes a time-out         help tune",
    "watch [points], capture FILE|off  frames as they come, or points that change             help capture",
    "clear stats|log                  forgets",
    "save, load                       settings of the next start",
    "reboot, exit                     the gateway's end, the session's end",
];

/// The text for the rest of a line that began with `help`.
pub(super) fn topic(words: &Words) -> Result<&'static [&'static str], Wrong> {
    if words.peek().is_end() {
        return Ok(OVERVIEW);
    }
    let lines = words.take().keyword(TOPICS, "a command (see help)")?;
    words.end()?;
    Ok(lines)
}

#[cfg(test)]
mod tests {
    use super::super::command::COMMANDS;
    use super::*;

    #[test]
    fn every_command_has_its_help() {
        for (command, _) in COMMANDS {
            assert!(TOPICS.iter().any(|(topic, lines)| topic == command && lines[0].starts_with(command)));
        }
        assert_eq!(TOPICS.len(), COMMANDS.len());
    }
}
