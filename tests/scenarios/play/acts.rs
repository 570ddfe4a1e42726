//! What each step does, except those of clients.

use std::net::{IpAddr, Ipv4Addr};
use std::str::FromStr;

use embassy_futures::select::select;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::Write;
use mobgate::stats::Event;
use mobgate_simulator::{Random, World, console, fault::babble};

use super::Stage;
use crate::faults::faults;
use crate::script::{each, exchange};
use crate::words::{bytes, duration, listed, number, words};

/// Time for the gateway to take note of something that has just been done to it.
const MOMENT: Duration = Duration::from_millis(1);

impl Stage<'_, '_, '_> {
    /// Does what a sentence says.
    pub(super) fn act(&mut self, world: &mut World<'_>, sentence: &str) -> Result<(), String> {
        if let Some(line) = sentence.strip_prefix("console: ") {
            self.rig.console(line)?;
            world.run_for(MOMENT);
            return Ok(());
        }
        if let Some(line) = sentence.strip_prefix("console refuses: ") {
            let taken = self.rig.console(line).is_ok();
            world.run_for(MOMENT);
            return equal("the line was taken", taken, false);
        }
        for (separator, expected) in [(" has no:", false), (" has:", true)] {
            if let Some((command, phrases)) = sentence.split_once(separator) {
                let shown = world.run_until(console::typed(self.rig.gateway, command));
                let is_right = has(&shown, phrases) == expected;
                return if is_right { Ok(()) } else { Err(format!("it shows\n{shown}")) };
            }
        }
        if let Some((count, repeated)) = sentence.split_once(" times: ") {
            let mut once =
                || repeated.split("; ").flat_map(each).try_for_each(|sentence| self.act(world, &sentence));
            return (0..number(count)?).try_for_each(|_| once());
        }
        if let Some((question, response)) = exchange(sentence) {
            self.act(world, question)?;
            return self.act(world, &response);
        }
        self.act_words(world, &words(sentence))
    }

    fn act_words(&mut self, world: &mut World<'_>, words: &[&str]) -> Result<(), String> {
        let network = &self.rig.network;
        match words {
            ["wait", time] => world.run_for(duration(time)?),
            ["at", time] => {
                let at = self.begun + duration(time)?;
                if at < Instant::now() {
                    return Err("that time has passed".to_owned());
                }
                world.run_until(Timer::at(at));
            }
            ["port", port, "counted", counts @ ..] => return self.counted(port, counts),
            ["port", port, "has", "last", "error", error @ ..] => {
                let id = self.rig.gateway.settings(|settings| settings.find(port));
                let id = id.ok_or("there is no such port")?;
                let last = self.rig.gateway.ports()[id.index()].stats.last_error();
                return equal("the last error", last.name(), &error.join(" "));
            }
            [count, "clients", "come", "and", "go", "on", port] => {
                return self.crowd(world, number(count)?, number(port)?);
            }
            ["unit", unit, "on", device, what @ ..] => return self.unit(device, number(unit)?, what),
            ["server", server, "is", "unreachable"] => network.set_unreachable(address(server)?, true),
            ["server", server, "is", "reachable"] => network.set_unreachable(address(server)?, false),
            ["server", server, "listens"] => return self.listen(world, address(server)?),
            ["name", name, "is", ip] => network.set_name(name, Some(address(ip)?)),
            ["network", "made", count, "connection" | "connections"] => {
                return equal("connections made", network.counters().made, number(count)?);
            }
            ["network", "used", count, "sockets", "at", "most"] => {
                return equal("sockets used", network.counters().sockets_most, number(count)?);
            }
            ["wire", device, what @ ..] => return self.wire(world, device, what),
            ["point", name, what @ ..] => return self.point(name, what),
            ["mark", device, function, range] => return self.mark(device, number(function)?, range),
            [client, action @ ..] => return self.clients.act(world, self.rig, client, action),
            [] => return Err("an empty step".to_owned()),
        }
        Ok(())
    }

    fn counted(&self, port: &str, counts: &[&str]) -> Result<(), String> {
        for count in listed(counts) {
            let [count, name] = count[..] else {
                return Err("a count and a counter's name are missing".to_owned());
            };
            let event = Event::ALL.iter().find(|known| known.name() == name);
            let event = *event.ok_or("no counter has this name")?;
            equal(name, self.rig.counted(port, event), number(count)?)?;
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

    fn unit(&self, bus: &str, unit: u8, what: &[&str]) -> Result<(), String> {
        let device = self.devices.get(&(bus.to_owned(), unit)).ok_or("there is no such device")?;
        let pdus = |words| listed(words).iter().map(|pdu| bytes(pdu)).collect::<Result<Vec<_>, _>>();
        match what {
            [":", "well"] => device.set_faults(faults::<&str>(u64::from(unit), &[])?),
            [":", "responds", pdu @ ..] => device.set_response(&bytes(pdu)?),
            [":", "register", address, "=", value] => {
                device.memory().holding[number::<usize>(address)?] = number(value)?;
            }
            [":", fault @ ..] => device.set_faults(faults(u64::from(unit), &[fault.join(" ")])?),
            ["saw", count, "request" | "requests"] => {
                return equal("requests seen", device.counters().all_requests(), number(count)?);
            }
            ["tripped", count, "time" | "times"] => {
                return equal("trips", device.trips(), number(count)?);
            }
            ["was", "asked", requests @ ..] => {
                let asked = device.take_requests();
                if asked != if *requests == ["nothing"] { Vec::new() } else { pdus(requests)? } {
                    return Err(format!("it was asked {asked:02X?}"));
                }
            }
            ["executed", count, "write" | "writes" | "write," | "writes,", last @ ..] => {
                let writes: Vec<_> = device.writes().into_iter().map(|write| write.pdu).collect();
                equal("writes executed", writes.len(), number(count)?)?;
                match last {
                    [] => {}
                    ["the", "last", last @ ..] if writes.ends_with(&pdus(last)?) => {}
                    _ => return Err(format!("they are {writes:02X?}")),
                }
            }
            ["heard", count, "gap" | "gaps"] => {
                return equal("gaps within frames", device.counters().gap_inside, number(count)?);
            }
            ["holds", value, "at", address] => {
                let is = device.memory().holding[number::<usize>(address)?];
                return equal("the register", is, number(value)?);
            }
            _ => return Err("a unit has a fault, saw requests, executed writes or holds values".to_owned()),
        }
        Ok(())
    }

    fn wire(&self, world: &mut World<'_>, name: &str, what: &[&str]) -> Result<(), String> {
        let end = self.rig.end(name);
        let stranger = || self.strangers.get(name).cloned().ok_or("nothing is connected to this wire");
        match what {
            [":", "unplugged"] => end.unplug(),
            [":", "plugged", "in"] => end.replug(),
            [":", "swapped"] => end.set_swapped(true),
            [":", "right"] => end.set_swapped(false),
            [":", "noise", noise @ ..] => {
                let sent = world.run_until(stranger()?.write_all(&bytes(noise)?));
                sent.map_err(|error| error.to_string())?;
            }
            [":", "babbles", "for", time] => {
                let until = Timer::after(duration(time)?);
                let babbling = babble(stranger()?, Random::new(1), 16, Duration::from_ticks(0));
                world.spawn(select(babbling, until));
            }
            ["had", count, "collision" | "collisions"] => {
                return equal("collisions", self.rig.wire(name).collisions(), number(count)?);
            }
            ["carried", count, "frame" | "frames", "from", "the", "gateway"] => {
                let frames = self.rig.wire(name).record_of(end).frames;
                return equal("frames from the gateway", frames, number(count)?);
            }
            _ => return Err("nothing of the kind happens on a wire".to_owned()),
        }
        Ok(())
    }
}

fn address<T: FromStr>(word: &str) -> Result<T, String> {
    word.parse()
        .map_err(|_| format!("{word} is no address such as 10.0.1.1, with :502 where it is a server's"))
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
