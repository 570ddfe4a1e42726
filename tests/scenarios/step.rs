//! Steps: one line each, a sentence whose first word says who acts.

use std::net::{IpAddr, SocketAddr};

use embassy_time::Duration;
use mobgate::stats::Event;

use crate::words::{bytes, duration, number, request};

/// Something that happens, or something that must have come of it.
pub(crate) enum Step {
    /// `wait 500ms`
    Wait(Duration),
    /// `at 2s`
    At(Duration),
    /// `console: delete port bus`; `console refuses: ...`
    Console { line: String, refused: bool },
    /// `port bus counted 2 timeouts, 1 retries`
    Counted { port: String, counts: Vec<(u32, Event)> },
    /// `port bus has last error bad checksum`
    LastError { port: String, error: String },
    /// `show units has: 5 up ... 6 down`; `show units has no: down`
    Shows { command: String, phrases: String, not: bool },
    /// `scada asks ... -> ...`
    Exchange(Box<Step>, Box<Step>),
    /// `16 times: scada asks ... -> ...; plc sends ...`
    Times(usize, Vec<Step>),
    /// `100 clients come and go on 502`
    Crowd { count: usize, port: u16 },
    /// `unit 5 on uart1 ...`
    Unit { unit: u8, device: String, what: OfUnit },
    /// `server 10.0.1.1:502 is unreachable`, `is reachable`, `listens`
    Server { address: SocketAddr, what: OfServer },
    /// `name meter.example is 10.0.1.2`
    Name { name: String, address: IpAddr },
    /// `network made 3 connections`
    Made(u64),
    /// `network used 2 sockets at most`
    SocketsUsed(u64),
    /// `wire uart1 ...`
    Wire { device: String, what: OfWire },
    /// `point power ...`
    Point { name: String, what: OfPoint },
    /// `mark meter 3 0-9`
    Mark { device: String, function: u8, range: (u16, u16) },
    /// `scada ...`
    Client { name: String, action: Action },
}

/// What a device does, or has done.
pub(crate) enum OfUnit {
    /// `: always dead`; `: well` is no faults.
    Faults(Vec<String>),
    /// `saw 3 requests`
    Saw(u64),
    /// `was asked 03 0000 0001, 06 0007 0063`, `was asked nothing`: since this was looked at last.
    WasAsked(Vec<Vec<u8>>),
    /// `executed 1 write`; `executed 3 writes, the last 06 0007 0063, 05 0003 FF00`
    Executed(usize, Vec<Vec<u8>>),
    /// `heard 0 gaps` within frames
    HeardGaps(u64),
    /// `holds 1234 at 7`
    Holds(u16, u16),
    /// `: answers 11 05 41636D65`, whatever it is asked
    Answers(Vec<u8>),
    /// `: register 7 = 1234`
    Set(u16, u16),
}

/// What becomes of a server in the network.
pub(crate) enum OfServer {
    Unreachable(bool),
    Listens,
}

/// What is done with a data point, or is to be seen of it.
pub(crate) enum OfPoint {
    /// `is ok to-read`: the status word in words.
    Is(String),
    /// `holds 17 18`
    Holds(String),
    /// `: read`
    IsRead,
    /// `: write`, `: write 17 18`
    IsWritten(Option<String>),
    /// `: begin`
    Begin,
    /// `: finish`
    Finish,
}

/// What happens on a wire, or has happened.
pub(crate) enum OfWire {
    /// `: unplugged`
    Unplugged,
    /// `: plugged in`
    PluggedIn,
    /// `: swapped`, `: right`
    Swapped(bool),
    /// `: noise 01 02 03`
    Noise(Vec<u8>),
    /// `: babbles for 5s`
    Babbles(Duration),
    /// `carried 2 frames from the gateway`
    Carried(u64),
    /// `had 0 collisions`
    Collided(u64),
}

/// What a client does or gets.
pub(crate) enum Action {
    /// `connects`
    Connects,
    /// `is refused`
    IsRefused,
    /// `leaves`, `resets`, `vanishes`
    Goes(Going),
    /// `asks unit 5: read 1 holding register from 0`
    Asks(u8, Vec<u8>),
    /// `sends 00 01`
    Sends(Vec<u8>),
    /// `gets 03 02 00 05 after 1s within 2s`
    Gets(Expected, Times),
    /// `gets nothing for 1s`
    GetsNothing(Duration),
    /// `is closed within 1s`
    IsClosed(Times),
}

/// How a client ends its connection.
pub(crate) enum Going {
    Leaves,
    Resets,
    Vanishes,
}

/// A response.
pub(crate) enum Expected {
    /// These bytes.
    Pdu(Vec<u8>),
    /// `exception 0B`
    Exception(u8),
    /// `the response of unit 5`: what a device with that id that nobody has written to answers.
    OfUnit(u8),
    /// `its own answer`: that of the unit that it has asked.
    Own,
    /// `fresh values`: read between question and answer.
    Fresh,
    /// `a damaged frame`, on a serial line.
    Damaged,
    /// `an answer`
    Any,
}

/// Bounds of a time since the question.
#[derive(Default)]
pub(crate) struct Times {
    pub(crate) after: Option<Duration>,
    pub(crate) within: Option<Duration>,
}

/// Reads all steps of a scenario, each with its line. Answers to questions that are asked side by side come behind all of them.
pub(crate) fn steps(text: &str) -> Result<Vec<(&str, Step)>, String> {
    let (mut steps, mut answers) = (Vec::new(), Vec::new());
    for line in text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#')) {
        let told = |error: String| format!("at `{line}`: {error}");
        let (pause, sentence) = beside(line).unwrap_or_else(|| {
            steps.append(&mut answers);
            (None, line)
        });
        steps.extend(pause.map(|pause| (line, Step::Wait(pause))));
        match step(sentence).map_err(told)? {
            Step::Exchange(question, answer) => {
                steps.push((line, *question));
                answers.push((line, *answer));
            }
            other => steps.push((line, other)),
        }
    }
    steps.append(&mut answers);
    Ok(steps)
}

/// What happens before the answers to the lines above: `and ...`, `5ms later ...`.
fn beside(line: &str) -> Option<(Option<Duration>, &str)> {
    let (time, rest) = line.split_once(' ')?;
    match time {
        "and" => Some((None, rest)),
        _ => Some((Some(duration(time).ok()?), rest.strip_prefix("later ")?)),
    }
}

/// Reads a line of a scenario's steps.
fn step(line: &str) -> Result<Step, String> {
    for (begin, refused) in [("console refuses:", true), ("console:", false)] {
        if let Some(line) = line.strip_prefix(begin) {
            return Ok(Step::Console { line: line.trim().to_owned(), refused });
        }
    }
    for (has, not) in [(" has no:", true), (" has:", false)] {
        if let Some((command, phrases)) = line.split_once(has) {
            return Ok(Step::Shows { command: command.to_owned(), phrases: phrases.to_owned(), not });
        }
    }
    if let Some((count, repeated)) = line.split_once(" times: ") {
        return Ok(Step::Times(number(count)?, repeated.split("; ").map(step).collect::<Result<_, _>>()?));
    }
    if let Some((question, answer)) = line.split_once(" -> ") {
        let client = question.split(' ').next().unwrap_or_default();
        let answer = step(&format!("{client} gets {answer}"))?;
        return Ok(Step::Exchange(Box::new(step(question)?), Box::new(answer)));
    }
    let words: Vec<&str> = line.split_whitespace().collect();
    Ok(match &words[..] {
        ["wait", time] => Step::Wait(duration(time)?),
        ["at", time] => Step::At(duration(time)?),
        ["port", port, "counted", counts @ ..] => {
            Step::Counted { port: (*port).to_owned(), counts: listed(counts, counted)? }
        }
        ["port", port, "has", "last", "error", error @ ..] => {
            Step::LastError { port: (*port).to_owned(), error: error.join(" ") }
        }
        [count, "clients", "come", "and", "go", "on", port] => {
            Step::Crowd { count: number(count)?, port: number(port)? }
        }
        ["unit", unit, "on", rest @ ..] => {
            let (device, rest) = name(rest)?;
            Step::Unit { unit: number(unit)?, device, what: of_unit(&rest)? }
        }
        ["server", address, what @ ..] => {
            let address = address.parse().map_err(|_| "an address such as 10.0.1.1:502 is missing")?;
            Step::Server { address, what: of_server(what)? }
        }
        ["name", name, "is", address] => {
            let address = address.parse().map_err(|_| "an address such as 10.0.1.1 is missing")?;
            Step::Name { name: (*name).to_owned(), address }
        }
        ["network", "made", count, "connection" | "connections"] => Step::Made(number(count)?),
        ["network", "used", count, "sockets", "at", "most"] => Step::SocketsUsed(number(count)?),
        ["wire", rest @ ..] => {
            let (device, rest) = name(rest)?;
            Step::Wire { device, what: of_wire(&rest)? }
        }
        ["point", rest @ ..] => {
            let (name, rest) = name(rest)?;
            Step::Point { name, what: of_point(&rest)? }
        }
        ["mark", device, function, range] => {
            let (first, last) = range.split_once('-').unwrap_or((range, range));
            let range = (number(first)?, number(last)?);
            Step::Mark { device: (*device).to_owned(), function: number(function)?, range }
        }
        [name, rest @ ..] => Step::Client { name: (*name).to_owned(), action: action(rest)? },
        [] => return Err("an empty step".to_owned()),
    })
}

/// A name, with the colon behind it as a word of its own.
fn name<'s>(words: &[&'s str]) -> Result<(String, Vec<&'s str>), String> {
    let (&first, rest) = words.split_first().ok_or("a name is missing")?;
    Ok(match first.strip_suffix(':') {
        Some(name) => (name.to_owned(), [&[":"], rest].concat()),
        None => (first.to_owned(), rest.to_vec()),
    })
}

fn of_unit(words: &[&str]) -> Result<OfUnit, String> {
    Ok(match words {
        [":", "well"] => OfUnit::Faults(Vec::new()),
        [":", "answers", pdu @ ..] => OfUnit::Answers(bytes(pdu)?),
        [":", "register", address, "=", value] => OfUnit::Set(number(address)?, number(value)?),
        [":", fault @ ..] => OfUnit::Faults(vec![fault.join(" ")]),
        ["was", "asked", "nothing"] => OfUnit::WasAsked(Vec::new()),
        ["was", "asked", pdus @ ..] => OfUnit::WasAsked(listed(pdus, bytes)?),
        ["saw", count, "request" | "requests"] => OfUnit::Saw(number(count)?),
        ["executed", count, "write" | "writes"] => OfUnit::Executed(number(count)?, Vec::new()),
        ["executed", count, "write," | "writes,", "the", "last", pdus @ ..] => {
            OfUnit::Executed(number(count)?, listed(pdus, bytes)?)
        }
        ["heard", count, "gap" | "gaps"] => OfUnit::HeardGaps(number(count)?),
        ["holds", value, "at", address] => OfUnit::Holds(number(value)?, number(address)?),
        _ => return Err("a unit has a fault, saw requests, executed writes or holds values".to_owned()),
    })
}

/// What is read from each of several parts with commas between them.
fn listed<T>(words: &[&str], part: fn(&[&str]) -> Result<T, String>) -> Result<Vec<T>, String> {
    let read = |words: &str| part(&words.split_whitespace().collect::<Vec<_>>());
    words.join(" ").split(',').map(read).collect()
}

fn counted(words: &[&str]) -> Result<(u32, Event), String> {
    let [count, event] = words else { return Err("a count and a counter's name are missing".to_owned()) };
    let event = Event::ALL.into_iter().find(|known| known.name() == *event);
    Ok((number(count)?, event.ok_or("no counter has this name")?))
}

fn of_server(words: &[&str]) -> Result<OfServer, String> {
    Ok(match words {
        ["is", "unreachable"] => OfServer::Unreachable(true),
        ["is", "reachable"] => OfServer::Unreachable(false),
        ["listens"] => OfServer::Listens,
        _ => return Err("a server is unreachable or reachable, or listens".to_owned()),
    })
}

fn of_point(words: &[&str]) -> Result<OfPoint, String> {
    Ok(match words {
        ["is", status @ ..] => OfPoint::Is(status.join(" ")),
        ["holds", values @ ..] => OfPoint::Holds(values.join(" ")),
        [":", "read"] => OfPoint::IsRead,
        [":", "write"] => OfPoint::IsWritten(None),
        [":", "write", values @ ..] => OfPoint::IsWritten(Some(values.join(" "))),
        [":", "begin"] => OfPoint::Begin,
        [":", "finish"] => OfPoint::Finish,
        _ => Err("a point is something, holds values, or is read, written, begun or finished")?,
    })
}

fn of_wire(words: &[&str]) -> Result<OfWire, String> {
    Ok(match words {
        [":", "unplugged"] => OfWire::Unplugged,
        [":", "plugged", "in"] => OfWire::PluggedIn,
        [":", "swapped"] => OfWire::Swapped(true),
        [":", "right"] => OfWire::Swapped(false),
        [":", "noise", noise @ ..] => OfWire::Noise(bytes(noise)?),
        [":", "babbles", "for", time] => OfWire::Babbles(duration(time)?),
        ["carried", count, "frame" | "frames", "from", "the", "gateway"] => OfWire::Carried(number(count)?),
        ["had", count, "collision" | "collisions"] => OfWire::Collided(number(count)?),
        _ => Err(
            "a wire is unplugged, plugged in, swapped or right, has noise or collisions, babbles, or carried frames",
        )?,
    })
}

fn action(words: &[&str]) -> Result<Action, String> {
    Ok(match words {
        ["connects"] => Action::Connects,
        ["is", "refused"] => Action::IsRefused,
        ["leaves"] => Action::Goes(Going::Leaves),
        ["resets"] => Action::Goes(Going::Resets),
        ["vanishes"] => Action::Goes(Going::Vanishes),
        ["asks", "unit", unit, pdu @ ..] => {
            let unit = unit.strip_suffix(':').ok_or("a colon is missing behind the unit")?;
            Action::Asks(number(unit)?, request(pdu)?)
        }
        ["sends", sent @ ..] => Action::Sends(bytes(sent)?),
        ["gets", "nothing", "for", time] => Action::GetsNothing(duration(time)?),
        ["gets", rest @ ..] => {
            let (answer, times) = times(rest)?;
            Action::Gets(expected(answer)?, times)
        }
        ["is", "closed", rest @ ..] => match times(rest)? {
            ([], times) => Action::IsClosed(times),
            _ => return Err("after `is closed` comes at most a time".to_owned()),
        },
        _ => return Err("this is no sentence about a client".to_owned()),
    })
}

/// Takes `after T` and `within T` off the end.
fn times<'w, 's>(words: &'w [&'s str]) -> Result<(&'w [&'s str], Times), String> {
    let mut words = words;
    let mut times = Times::default();
    loop {
        match words {
            [rest @ .., "within", time] => {
                times.within = Some(duration(time)?);
                words = rest;
            }
            [rest @ .., "after", time] => {
                times.after = Some(duration(time)?);
                words = rest;
            }
            _ => return Ok((words, times)),
        }
    }
}

fn expected(words: &[&str]) -> Result<Expected, String> {
    Ok(match words {
        ["exception", code] => match bytes(&[code])?[..] {
            [code] => Expected::Exception(code),
            _ => return Err("an exception code is one byte".to_owned()),
        },
        ["the", "answer", "of", "unit", unit] => Expected::OfUnit(number(unit)?),
        ["its", "own", "answer"] => Expected::Own,
        ["fresh", "values"] => Expected::Fresh,
        ["a", "damaged", "frame"] => Expected::Damaged,
        ["an", "answer"] => Expected::Any,
        _ => Expected::Pdu(bytes(words)?),
    })
}
