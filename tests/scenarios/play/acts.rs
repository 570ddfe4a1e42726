//! What each step does, except those of clients.

use std::net::{IpAddr, Ipv4Addr};

use embassy_futures::select::select;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::Write;
use mobgate_simulator::{Random, World, console, fault::babble};

use super::Stage;
use crate::faults::faults;
use crate::step::{OfServer, OfUnit, OfWire, Step};

/// Time for the gateway to take note of something that has just been done to it.
const MOMENT: Duration = Duration::from_millis(1);

impl Stage<'_, '_, '_> {
    /// Takes a step.
    pub(super) fn act(&mut self, world: &mut World<'_>, step: &Step) -> Result<(), String> {
        match step {
            Step::Wait(time) => world.run_for(*time),
            Step::At(at) if self.begun + *at < Instant::now() => {
                return Err("that time has passed".to_owned());
            }
            Step::At(at) => world.run_until(Timer::at(self.begun + *at)),
            Step::Console { line, refused } => {
                match (self.rig.console(line), refused) {
                    (Ok(()), true) => return Err("the line was taken".to_owned()),
                    (Err(error), false) => return Err(error),
                    _ => {}
                }
                world.run_for(MOMENT);
            }
            Step::Shows { command, phrases, not } => {
                let shown = world.run_until(console::typed(self.rig.gateway, command));
                if has(&shown, phrases) == *not {
                    return Err(format!("it shows\n{shown}"));
                }
            }
            Step::Exchange(question, answer) => {
                self.act(world, question)?;
                return self.act(world, answer);
            }
            Step::Times(count, steps) => {
                return (0..*count).try_for_each(|_| steps.iter().try_for_each(|step| self.act(world, step)));
            }
            Step::Counted { port, counts } => {
                return counts.iter().try_for_each(|(count, event)| {
                    equal(event.name(), self.rig.counted(port, *event), *count)
                });
            }
            Step::LastError { port, error } => {
                let id = self.rig.gateway.settings(|settings| settings.find(port));
                let id = id.ok_or("there is no such port")?;
                let last = self.rig.gateway.ports()[id.index()].stats.last_error();
                return equal("the last error", last.name(), error);
            }
            Step::Crowd { count, port } => return self.crowd(world, *count, *port),
            Step::Unit { unit, device, what } => return self.unit(device, *unit, what),
            Step::Server { address, what: OfServer::Unreachable(unreachable) } => {
                self.rig.network.set_unreachable(*address, *unreachable);
            }
            Step::Server { address, what: OfServer::Listens } => return self.listen(world, *address),
            Step::Name { name, address } => self.rig.network.set_name(name, Some(*address)),
            Step::Made(count) => {
                return equal("connections made", self.rig.network.counters().made, *count);
            }
            Step::SocketsUsed(count) => {
                return equal("sockets used", self.rig.network.counters().sockets_most, *count);
            }
            Step::Wire { device, what } => return self.wire(world, device, what),
            Step::Point { name, what } => return self.point(name, what),
            Step::Mark { device, function, range } => return self.mark(device, *function, *range),
            Step::Client { name, action } => return self.clients.act(world, self.rig, name, action),
        }
        Ok(())
    }

    /// Connections that are opened and dropped, some with half a request.
    fn crowd(&self, world: &mut World<'_>, count: usize, port: u16) -> Result<(), String> {
        for number in 0..count {
            let from = IpAddr::V4(Ipv4Addr::from_bits(0x0a80_0000 + number as u32));
            // Whether it is let in is not the crowd's concern.
            let Ok(mut stream) = self.rig.network.connect(from, port) else { continue };
            if number % 3 == 0 {
                let half = world.run_until(stream.write_all(&[0, 1, 0, 0, 0, 6, 1]));
                half.map_err(|error| format!("half a request: {error}"))?;
            }
            if number % 2 == 0 {
                stream.reset();
            }
            if number % 16 == 0 {
                world.run_for(MOMENT);
            }
        }
        Ok(())
    }

    fn unit(&self, bus: &str, unit: u8, what: &OfUnit) -> Result<(), String> {
        let device = self.devices.get(&(bus.to_owned(), unit)).ok_or("there is no such device")?;
        match what {
            OfUnit::Faults(sentences) => device.set_faults(faults(u64::from(unit), sentences)?),
            OfUnit::Saw(count) => return equal("requests seen", device.counters().all_requests(), *count),
            OfUnit::WasAsked(requests) => {
                let asked = device.take_requests();
                if asked != *requests {
                    return Err(format!("it was asked {asked:02X?}"));
                }
            }
            OfUnit::Executed(count, last) => {
                let writes = device.writes();
                equal("writes executed", writes.len(), *count)?;
                let pdus: Vec<_> = writes.into_iter().map(|write| write.pdu).collect();
                if !pdus.ends_with(last) {
                    return Err(format!("they are {pdus:02X?}"));
                }
            }
            OfUnit::Answers(pdu) => device.set_response(pdu),
            OfUnit::Set(address, value) => device.memory().holding[usize::from(*address)] = *value,
            OfUnit::HeardGaps(count) => {
                return equal("gaps within frames", device.counters().gap_inside, *count);
            }
            OfUnit::Holds(value, address) => {
                return equal("the register", device.memory().holding[usize::from(*address)], *value);
            }
        }
        Ok(())
    }

    fn wire(&self, world: &mut World<'_>, name: &str, what: &OfWire) -> Result<(), String> {
        let end = self.rig.end(name);
        let stranger = || self.strangers.get(name).cloned().ok_or("nothing is connected to this wire");
        match what {
            OfWire::Unplugged => end.unplug(),
            OfWire::PluggedIn => end.replug(),
            OfWire::Swapped(swapped) => end.set_swapped(*swapped),
            OfWire::Noise(noise) => {
                let sent = world.run_until(stranger()?.write_all(noise));
                sent.map_err(|error| error.to_string())?;
            }
            OfWire::Babbles(time) => {
                let until = Timer::after(*time);
                let babbling = babble(stranger()?, Random::new(1), 16, Duration::from_ticks(0));
                world.spawn(select(babbling, until));
            }
            OfWire::Collided(count) => {
                return equal("collisions", self.rig.wire(name).collisions(), *count);
            }
            OfWire::Carried(count) => {
                let frames = self.rig.wire(name).record_of(end).frames;
                return equal("frames from the gateway", frames, *count);
            }
        }
        Ok(())
    }
}

/// Whether `text` has all the phrases between dots, in their order; how much space there is does not matter.
fn has(text: &str, phrases: &str) -> bool {
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let mut rest = Some(&text[..]);
    for phrase in phrases.split(" ... ") {
        rest = rest.and_then(|rest| rest.split_once(phrase.trim())).map(|(_, rest)| rest);
    }
    rest.is_some()
}

pub(super) fn equal<T: PartialEq + std::fmt::Display>(what: &str, is: T, should: T) -> Result<(), String> {
    if is == should { Ok(()) } else { Err(format!("{what}: {is}, not {should}")) }
}
