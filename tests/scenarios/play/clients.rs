//! The clients of a case: what they send, what they must get, and that nothing else comes.

use std::collections::BTreeMap;

use embassy_time::{Duration, Instant, with_timeout};
use mobgate_simulator::client::Reply;
use mobgate_simulator::client::session::{Arrival, Session};
use mobgate_simulator::device::{Fresh, Memory};
use mobgate_simulator::net::{ClientStream, Path};
use mobgate_simulator::{Rig, World};

use crate::file::{By, Client};
use crate::words::{bytes, duration, number, request};

/// How long a step waits for what it expects, beyond the time that it names.
const PATIENCE: Duration = Duration::from_secs(30);

/// All clients of a case.
pub(super) struct Clients<'s> {
    setups: &'s BTreeMap<String, Client>,
    connected: BTreeMap<String, Connected>,
}

struct Connected {
    session: Session,
    questions: BTreeMap<u16, Question>,
}

struct Question {
    unit: u8,
    pdu: Vec<u8>,
    at: Instant,
}

impl<'s> Clients<'s> {
    pub(super) fn new(setups: &'s BTreeMap<String, Client>) -> Self {
        Self { setups, connected: BTreeMap::new() }
    }

    /// Lets the client `name` do or get something; it connects at its first action.
    pub(super) fn act(
        &mut self,
        world: &mut World<'_>,
        rig: &Rig<'_>,
        name: &str,
        action: &[&str],
    ) -> Result<(), String> {
        let setup = self.setups.get(name).ok_or_else(|| format!("nobody is called {name}"))?;
        match action {
            ["is", "refused"] => {
                return match connect(world, rig, setup) {
                    Ok(_) => Err("it could connect".to_owned()),
                    Err(_) => Ok(()),
                };
            }
            [going @ ("leaves" | "resets" | "vanishes")] => {
                let client = self.connected.remove(name).ok_or("it is not connected")?;
                client.check_nothing_came(name)?;
                match *going {
                    "leaves" => drop(client),
                    "resets" => client.stream()?.reset(),
                    _ => client.stream()?.vanish(),
                }
                return Ok(());
            }
            _ => {}
        }
        if !self.connected.contains_key(name) || action == ["connects"] {
            let session = connect(world, rig, setup)?;
            let client = Connected { session, questions: BTreeMap::new() };
            if self.connected.insert(name.to_owned(), client).is_some() {
                return Err("it is connected already".to_owned());
            }
        }
        self.connected.get_mut(name).ok_or("it is not connected")?.act(world, action)
    }

    /// Every question has its response, and nobody got anything besides.
    pub(super) fn check_nothing_is_left(&self) -> Result<(), String> {
        for (name, client) in &self.connected {
            client.check_nothing_came(name)?;
            if let Some(question) = client.questions.values().next() {
                return Err(format!("{name} has no response from unit {} yet", question.unit));
            }
        }
        Ok(())
    }

    /// All clients close their connections.
    pub(super) fn leave(&mut self) {
        self.connected.clear();
    }
}

fn connect(world: &World<'_>, rig: &Rig<'_>, setup: &Client) -> Result<Session, String> {
    if let Some(device) = &setup.on {
        let line = rig.wire(device).tap(rig.end(device).line());
        return Ok(Session::on_line(line, rig.framing(device), world));
    }
    if setup.by == By::Udp {
        return Ok(Session::datagrams(rig.network.udp_client(setup.from, setup.port), world));
    }
    let optional = |time: &Option<String>| time.as_deref().map_or(Ok(Duration::from_ticks(0)), duration);
    let path = Path {
        latency: optional(&setup.latency)?,
        piece_bytes_max: setup.pieces,
        piece_spacing: optional(&setup.spacing)?,
        coalesce: optional(&setup.coalesce)?,
        window_bytes: setup.window.unwrap_or(Path::default().window_bytes),
    };
    let stream = rig.network.connect_over(path, setup.from, setup.port);
    let stream = stream.map_err(|error| format!("it cannot connect: {error}"))?;
    Ok(match setup.by {
        _ if setup.deaf => Session::deaf(stream),
        By::Rtu => Session::rtu(stream, world),
        _ => Session::start(stream, world),
    })
}

impl Connected {
    fn stream(self) -> Result<ClientStream, String> {
        self.session.into_stream().ok_or_else(|| "a line has no connection".to_owned())
    }

    fn act(&mut self, world: &mut World<'_>, action: &[&str]) -> Result<(), String> {
        match action {
            ["connects"] => Ok(()),
            ["asks", "unit", unit, ":", pdu @ ..] => {
                let (unit, pdu, at) = (number(unit)?, request(pdu)?, Instant::now());
                let transaction = world.run_until(self.session.send(unit, &pdu));
                self.questions
                    .insert(transaction.ok_or("its connection has ended")?, Question { unit, pdu, at });
                Ok(())
            }
            ["sends", sent @ ..] => match world.run_until(self.session.send_bytes(&bytes(sent)?)) {
                true => Ok(()),
                false => Err("its connection has ended".to_owned()),
            },
            ["gets", "nothing", "for", time] => {
                world.run_for(duration(time)?);
                self.questions.clear();
                self.check_nothing_came("it")
            }
            ["gets", response @ ..] => {
                let (expected, times) = Times::taken_off(response)?;
                self.gets(world, expected, &times)
            }
            ["is", "closed", times @ ..] => {
                let ([], times) = Times::taken_off(times)? else {
                    return Err("after `is closed` comes at most a time".to_owned());
                };
                let asked = Instant::now();
                match self.next(world, &times)? {
                    Arrival { at, reply: None } => times.check(at.saturating_duration_since(asked)),
                    Arrival { reply: Some(reply), .. } => Err(format!("it got {}", told(&reply))),
                }
            }
            _ => Err("this is no sentence about a client".to_owned()),
        }
    }

    fn gets(&mut self, world: &mut World<'_>, expected: &[&str], times: &Times) -> Result<(), String> {
        let arrival = self.next(world, times)?;
        let Some(reply) = arrival.reply else { return Err("the connection was closed".to_owned()) };
        let Some(question) = self.questions.remove(&reply.transaction) else {
            return Err(format!("it got {}, and has not asked", told(&reply)));
        };
        let is_corrupt = reply.pdu.is_empty();
        if is_corrupt != (expected == ["a", "corrupt", "frame"]) {
            return Err(format!("it got {}", told(&reply)));
        }
        if !is_corrupt && (reply.protocol, reply.unit) != (0, question.unit) {
            return Err(format!("it asked unit {} and got {}", question.unit, told(&reply)));
        }
        let of_unit = |unit| {
            let response = Memory::new(unit).execute(&question.pdu);
            response.unwrap_or_else(|code| vec![question.pdu[0] | 0x80, code])
        };
        let should = match expected {
            ["a", "corrupt", "frame"] | ["a", "response"] => reply.pdu.clone(),
            ["exception", code] => [vec![question.pdu[0] | 0x80], bytes(&[code])?].concat(),
            // What a device with that id that nobody has written to responds.
            ["the", "response", "of", "unit", unit] => of_unit(number(unit)?),
            ["its", "own", "response"] => of_unit(question.unit),
            ["fresh", "values"] => {
                let fresh = Fresh::from_response(&reply.pdu).ok_or_else(|| told(&reply))?;
                let read = Instant::from_micros(u64::from(fresh.at_us));
                if !(question.at..=arrival.at).contains(&read) {
                    return Err(format!("the values are of {read}, asked was at {}", question.at));
                }
                reply.pdu.clone()
            }
            pdu => bytes(pdu)?,
        };
        if reply.pdu != should {
            return Err(format!("it got {}, not {should:02X?}", told(&reply)));
        }
        times.check(arrival.at.saturating_duration_since(question.at))
    }

    fn next(&mut self, world: &mut World<'_>, times: &Times) -> Result<Arrival, String> {
        let patience = PATIENCE + times.within.unwrap_or(Duration::from_ticks(0));
        let arrival = world.run_until(with_timeout(patience, self.session.next()));
        arrival.map_err(|_| format!("it got nothing within {} s", patience.as_secs()))
    }

    fn check_nothing_came(&self, name: &str) -> Result<(), String> {
        match self.session.try_next() {
            None => Ok(()),
            Some(Arrival { reply: Some(reply), .. }) => Err(format!("{name} also got {}", told(&reply))),
            Some(Arrival { reply: None, at }) => Err(format!("{name} was disconnected at {at}")),
        }
    }
}

/// Bounds of a time since the question.
#[derive(Default)]
struct Times {
    after: Option<Duration>,
    within: Option<Duration>,
}

impl Times {
    /// Takes `after T` and `within T` off the end.
    fn taken_off<'w, 's>(mut words: &'w [&'s str]) -> Result<(&'w [&'s str], Self), String> {
        let mut times = Self::default();
        loop {
            let (rest, bound, time) = match words {
                [rest @ .., "within", time] => (rest, &mut times.within, time),
                [rest @ .., "after", time] => (rest, &mut times.after, time),
                _ => return Ok((words, times)),
            };
            *bound = Some(duration(time)?);
            words = rest;
        }
    }

    fn check(&self, took: Duration) -> Result<(), String> {
        let early = self.after.is_some_and(|after| took < after);
        let late = self.within.is_some_and(|within| took > within);
        if early || late { Err(format!("it took {} us", took.as_micros())) } else { Ok(()) }
    }
}

fn told(reply: &Reply) -> String {
    format!("{:02X?} from unit {} (transaction {})", reply.pdu, reply.unit, reply.transaction)
}
