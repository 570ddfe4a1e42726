//! What is on a wire: its ends, and their characters with their places in time.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::task::{Context, Waker};

use embassy_time::Instant;
use mobgate::hal::{Flaws, Relay};
use mobgate::settings::{LineSettings, Parity};

use super::character::{Character, Flaw};
use super::record::Record;
use crate::random::mix;
use crate::timing::{self, char_bits, chars_ns};

/// Characters that an end keeps for a reader that does not come; older ones are lost, as in a UART's driver.
const UNREAD_CHARS_MAX: u64 = 4_096;
/// Characters that an end takes for transmission before `write` waits, as in a UART's driver.
pub(super) const TRANSMIT_CHARS_MAX: u64 = 4_096;

/// The clock's tick.
pub(super) const TICK_NS: u64 = 1_000;

/// The bus. Clones are the same bus.
#[derive(Clone, Default)]
pub struct Wire(pub(super) Rc<RefCell<Bus>>);

#[derive(Default)]
pub(super) struct Bus {
    pub(super) ends: Vec<End>,
    /// By the end of the last bit; future ones included. Its first element has number `first`.
    characters: VecDeque<Character>,
    first: u64,
    pub(super) record: Record,
}

pub(super) struct End {
    pub(super) line: LineSettings,
    pub(super) echo: bool,
    /// Its two wires are swapped: it takes ones for zeros, and the idle line for a break.
    pub(super) swapped: bool,
    /// What its receiver has noticed.
    pub(super) flaws: Flaws,
    pub(super) plugged: bool,
    pub(super) opened: bool,
    /// Handles of an earlier number are dead: their adapter was unplugged.
    pub(super) generation: u32,
    /// The number of the character that is heard next.
    pub(super) next: u64,
    pub(super) run: Run,
    pub(super) waiting: Vec<Waker>,
    pub(super) overruns: u64,
    /// Another end sends what this one hears.
    pub(super) relayed: Option<Relayed>,
    pub(super) relayed_chars: u64,
}

/// An unbroken sequence of an end's characters.
#[derive(Default, Clone, Copy)]
pub(super) struct Run {
    start_ns: u64,
    characters: u64,
    pub(super) end_ns: u64,
}

pub(super) fn now_ns() -> u64 {
    Instant::now().as_micros() * 1_000
}

/// The first tick at which something at `ns` has happened.
pub(super) fn tick_after(ns: u64) -> u64 {
    ns.div_ceil(1_000)
}

/// A participant's handle. Clones are the same participant; what one clone reads, the others do not.
#[derive(Clone)]
pub struct LineEnd {
    pub(super) wire: Wire,
    pub(super) number: usize,
    pub(super) generation: u32,
}

/// The silent intervals by which a device tells frames apart, Modbus over Serial Line 2.5.1.1.
#[derive(Debug, Clone, Copy)]
pub struct Silence {
    /// A longer silence inside a frame spoils it.
    pub inside_ns: u64,
    /// This much silence ends a frame.
    pub between_ns: u64,
}

impl Silence {
    /// t1.5 and t3.5 of `line`.
    pub fn of(line: &LineSettings) -> Self {
        Self { inside_ns: timing::t1_5_ns(line), between_ns: timing::t3_5_ns(line) }
    }
}

/// A frame as a device hears it: everything between two silences.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Heard {
    /// The bytes.
    pub bytes: Vec<u8>,
    /// Whether a silence inside was longer than allowed.
    pub gap_inside: bool,
    /// When the last bit had passed.
    pub end_ns: u64,
}

/// The relay of what an end hears.
pub(super) struct Relayed {
    pub(super) relay: Relay,
    pub(super) to: LineEnd,
    /// The number of the character that is sent next.
    pub(super) next: u64,
    /// When the last character ended.
    pub(super) heard_ns: u64,
    pub(super) is_broken: bool,
}

impl Relayed {
    pub(super) fn is_running(&self) -> bool {
        !self.is_broken && !self.relay.is_over()
    }
}

impl Bus {
    /// The number of the first character that has not been heard yet.
    pub(super) fn first_unheard(&self) -> u64 {
        let now = now_ns();
        self.first + self.characters.partition_point(|character| character.end_ns <= now) as u64
    }

    /// The characters that `end` hears from its place on, future ones included, with their numbers.
    pub(super) fn audible_from(&self, end: usize) -> impl Iterator<Item = (u64, &Character)> {
        self.audible(end, self.ends[end].next)
    }

    /// The same from the character number `next` on.
    pub(super) fn audible(&self, end: usize, next: u64) -> impl Iterator<Item = (u64, &Character)> {
        let echo = self.ends[end].echo;
        let skipped = usize::try_from(next.saturating_sub(self.first)).unwrap_or(usize::MAX);
        let numbered = self.characters.iter().enumerate().skip(skipped);
        let numbered = numbered.map(|(index, character)| (self.first + index as u64, character));
        numbered.filter(move |(_, character)| match character.own {
            true => character.from == end,
            false => echo || character.from != end,
        })
    }

    /// Moves what `end` has heard by now to `into`, and says how much that was.
    pub(super) fn read(&mut self, end: usize, into: &mut [u8]) -> usize {
        let now = now_ns();
        let mut next = self.ends[end].next;
        let mut flaws = self.ends[end].flaws;
        let mut count = 0;
        let heard = self.audible_from(end).take_while(|(_, character)| character.end_ns <= now);
        for ((number, character), place) in heard.zip(into) {
            let (byte, flaw) = self.heard_as(character, end);
            *place = byte;
            flaws.parity += u32::from(flaw == Some(Flaw::Parity));
            flaws.framing += u32::from(flaw == Some(Flaw::Framing));
            count += 1;
            next = number + 1;
        }
        self.ends[end].next = next;
        self.ends[end].flaws = flaws;
        count
    }

    /// What `end` hears until the next silence, and the number of the character after it.
    pub(super) fn frame_from(&self, end: usize, silence: Silence) -> (Heard, u64) {
        let mut heard = Heard { bytes: Vec::new(), gap_inside: false, end_ns: 0 };
        let mut next = self.ends[end].next;
        for (number, character) in self.audible_from(end) {
            if !heard.bytes.is_empty() {
                let gap_ns = character.start_ns.saturating_sub(heard.end_ns);
                if gap_ns >= silence.between_ns {
                    break;
                }
                heard.gap_inside |= gap_ns > silence.inside_ns;
            }
            heard.bytes.push(self.heard_as(character, end).0);
            heard.end_ns = heard.end_ns.max(character.end_ns);
            next = number + 1;
        }
        (heard, next)
    }

    /// Lets `from` send `bytes` as soon as its transmitter is free; the one in the middle has the `flaw`.
    pub(super) fn transmit(&mut self, from: usize, bytes: &[u8], flaw: Option<Flaw>) {
        let now = now_ns();
        let Bus { ends, record, characters, .. } = self;
        let Some(end) = ends.get_mut(from) else { return };
        // What is written in the tick in which the last character has ended follows it at once: the clock knows no better.
        if end.run.end_ns + TICK_NS <= now {
            end.run = Run { start_ns: now, characters: 0, end_ns: now };
        }
        let line = end.line;
        let mut run = end.run;
        for (at, &byte) in bytes.iter().enumerate() {
            let start_ns = run.end_ns;
            run.characters += 1;
            run.end_ns = run.start_ns + chars_ns(&line, run.characters);
            let flaw = flaw.filter(|_| at == bytes.len() / 2);
            let character =
                Character { start_ns, end_ns: run.end_ns, from, byte, corrupt: false, flaw, own: false };
            record.add(&character, chars_ns(&line, 1));
            place(characters, record, character);
        }
        end.run = run;
        if end.swapped {
            let (start_ns, end_ns) = (run.end_ns, run.end_ns + chars_ns(&line, 1));
            let flaw = Some(Flaw::Framing);
            let idle = Character { start_ns, end_ns, from, byte: 0xff, corrupt: false, flaw, own: true };
            place(characters, record, idle);
        }
        self.drop_unread();
        let waiting: Vec<Waker> = self.ends.iter_mut().flat_map(|end| end.waiting.drain(..)).collect();
        waiting.into_iter().for_each(Waker::wake);
    }

    /// Forgets characters that every end has heard, or has left unread for too long.
    fn drop_unread(&mut self) {
        let heard = self.first_unheard();
        for end in &mut self.ends {
            let oldest = heard.saturating_sub(UNREAD_CHARS_MAX);
            if end.next < oldest {
                end.overruns += oldest - end.next;
                end.next = oldest;
            }
        }
        let needed = self.ends.iter().map(|end| end.next).min().unwrap_or(heard);
        let forgotten = usize::try_from(needed - self.first).unwrap_or(0).min(self.characters.len());
        self.characters.drain(..forgotten);
        self.first += forgotten as u64;
    }

    /// The byte that `end` takes `character` for, and what its receiver notices.
    pub(super) fn heard_as(&self, character: &Character, end: usize) -> (u8, Option<Flaw>) {
        let (sender, hearer) = (&self.ends[character.from], &self.ends[end]);
        let (sent_as, line) = (&sender.line, &hearer.line);
        let same = sent_as.baud == line.baud
            && sent_as.data_bits == line.data_bits
            && sent_as.parity == line.parity
            && char_bits(sent_as) == char_bits(line)
            && sender.swapped == hearer.swapped;
        if same && !character.corrupt && character.flaw.is_none() {
            return (character.byte, None);
        }
        let same_bits = sent_as.baud == line.baud && char_bits(sent_as) == char_bits(line);
        let flaw = match character.flaw {
            _ if same => character.flaw,
            _ if !same_bits || sender.swapped != hearer.swapped => Some(Flaw::Framing),
            _ => Some(Flaw::Parity).filter(|_| line.parity != Parity::None),
        };
        // Some byte that is never the right one, and the same in every run.
        let garbage = mix(character.start_ns ^ u64::from(line.baud)) as u8;
        (if garbage == character.byte { !garbage } else { garbage }, flaw)
    }
}

impl End {
    /// Characters that wait for transmission keep their places.
    pub(super) fn set_line(&mut self, line: LineSettings) {
        self.line = line;
        self.run = Run { start_ns: self.run.end_ns, characters: 0, end_ns: self.run.end_ns };
    }

    pub(super) fn wait(&mut self, context: &Context<'_>) {
        if !self.waiting.iter().any(|waker| waker.will_wake(context.waker())) {
            self.waiting.push(context.waker().clone());
        }
    }
}

/// Puts `character` among those on the wire, in the order in which they end, and corrupts what it overlaps.
fn place(characters: &mut VecDeque<Character>, record: &mut Record, mut character: Character) {
    let later = characters.iter().rev().take_while(|other| other.end_ns > character.start_ns);
    let overlapping = later.count();
    let length = characters.len();
    let mut at = length;
    for index in (length - overlapping..length).rev() {
        let other = &mut characters[index];
        if other.end_ns > character.end_ns {
            at = index;
        }
        let on_wire = !other.own && !character.own;
        if on_wire && other.from != character.from && other.start_ns < character.end_ns {
            record.collisions += u64::from(!other.corrupt) + u64::from(!character.corrupt);
            other.corrupt = true;
            character.corrupt = true;
        }
    }
    characters.insert(at, character);
}
