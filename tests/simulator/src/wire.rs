//! An RS-485 bus: whatever one end sends, every other end hears, at the speed of the line.
//!
//! A byte written to a [`LineEnd`] waits in its transmitter, becomes a character with its place in time, and is heard
//! when its last bit has passed. Times are kept in nanoseconds from the start of a run of characters, so that nothing
//! is rounded twice; only the moment of hearing is rounded up to the clock's microsecond. Characters of
//! two ends that overlap corrupt each other, and an end set to another speed or format hears garbage.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::task::{Context, Waker};

use embassy_time::{Duration, Instant};
use mobgate::hal::Flaws;
use mobgate::settings::{Framing, LineSettings, Parity};

use crate::random::mix;
use crate::timing::{char_bits, chars_ns, t1_5_ns, t3_5_ns};

mod end;
mod record;
mod relay;

pub use end::{Heard, LineEnd, Silence};
pub use record::{EndRecord, FRAMES_MAX, WireFrame};

use record::Record;
use relay::Relayed;

/// Characters that an end keeps for a reader that does not come; older ones are lost, as in a UART's driver.
const UNREAD_CHARS_MAX: u64 = 4_096;
/// Characters that an end takes for transmission before `write` waits, as in a UART's driver.
const TRANSMIT_CHARS_MAX: u64 = 4_096;

/// The clock's tick.
const TICK_NS: u64 = 1_000;

/// A character's place on the wire, in nanoseconds since the start.
#[derive(Debug, Clone, Copy)]
struct Character {
    start_ns: u64,
    end_ns: u64,
    from: usize,
    byte: u8,
    corrupt: bool,
    flaw: Option<Flaw>,
    /// Only the sender hears it: what a receiver with swapped wires makes of a line that falls idle.
    own: bool,
}

/// What a receiver notices of a bad character.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flaw {
    /// The parity bit is wrong.
    Parity,
    /// There is no stop bit where one should be.
    Framing,
}

/// The bus. Clones are the same bus.
#[derive(Clone, Default)]
pub struct Wire(Rc<RefCell<Bus>>);

#[derive(Default)]
struct Bus {
    ends: Vec<End>,
    /// By the end of the last bit; future ones included. Its first element has number `first`.
    characters: VecDeque<Character>,
    first: u64,
    record: Record,
}

struct End {
    line: LineSettings,
    echo: bool,
    /// Its two wires are swapped: it takes ones for zeros, and the idle line for a break.
    swapped: bool,
    /// What its receiver has noticed.
    flaws: Flaws,
    plugged: bool,
    opened: bool,
    /// Handles of an earlier number are dead: their adapter was unplugged.
    generation: u32,
    /// The number of the character that is heard next.
    next: u64,
    run: Run,
    waiting: Vec<Waker>,
    overruns: u64,
    /// Another end sends what this one hears.
    relayed: Option<Relayed>,
    relayed_chars: u64,
}

/// An unbroken sequence of an end's characters.
#[derive(Default, Clone, Copy)]
struct Run {
    start_ns: u64,
    characters: u64,
    end_ns: u64,
}

fn now_ns() -> u64 {
    Instant::now().as_micros() * 1_000
}

/// The first tick at which something at `ns` has happened.
fn tick_after(ns: u64) -> u64 {
    ns.div_ceil(1_000)
}

impl Wire {
    /// A bus with nobody on it.
    pub fn new() -> Self {
        Self::default()
    }

    /// Connects one more participant, with `line`'s speed and character format.
    pub fn tap(&self, line: LineSettings) -> LineEnd {
        let mut bus = self.0.borrow_mut();
        let next = bus.first_unheard();
        bus.ends.push(End {
            line,
            echo: false,
            swapped: false,
            flaws: Flaws::default(),
            plugged: true,
            opened: false,
            generation: 0,
            next,
            run: Run::default(),
            waiting: Vec::new(),
            overruns: 0,
            relayed: None,
            relayed_chars: 0,
        });
        bus.record.add_end();
        LineEnd::new(self.clone(), bus.ends.len() - 1, 0)
    }

    /// What participant `end` has done so far.
    pub fn record_of(&self, end: &LineEnd) -> EndRecord {
        self.0.borrow().record.ends[end.number()].clone()
    }

    /// The last frames on the wire, oldest first: at most [`FRAMES_MAX`].
    pub fn frames(&self) -> Vec<WireFrame> {
        self.0.borrow().record.frames.iter().cloned().collect()
    }

    /// The frames of `end`, in `framing`, that stood behind too short a silence: less than the line's gap, t3.5 if it says nothing.
    /// A pause of up to t1.5 inside a frame may be, or of `pause` where that is longer, and the clock knows no time to less than a
    /// tick. `end` cannot heed what it has not heard: what another began to send less than a character, and `reaction`, before, or
    /// in the middle of a frame of `end`.
    pub fn hasty_frames(
        &self,
        (end, framing): (&LineEnd, Framing),
        reaction: Duration,
        pause: Duration,
    ) -> Vec<WireFrame> {
        let (line, number) = (end.line(), end.number());
        let silence_ns = line.gap.map_or(t3_5_ns(&line), |gap| gap.as_nanos());
        let unheard_ns = chars_ns(&line, 1) + reaction.as_nanos() + TICK_NS;
        let frames = self.frames();
        let hasty = |index: &usize| {
            let (before, frame) = (&frames[index - 1], &frames[*index]);
            let own = frames[..*index].iter().rfind(|frame| frame.from == number);
            let gap_ns = frame.gap_ns.unwrap_or(u64::MAX);
            let pause = if before.from == number { pause } else { Duration::from_ticks(0) };
            let pause_ns = t1_5_ns(&line).max(pause.as_nanos()) + TICK_NS;
            let is_pause =
                own.is_some_and(|own| frame.goes_on(own, framing) && frame.start_ns <= own.end_ns + pause_ns);
            let unheard = before.from != number && frame.start_ns <= before.start_ns + unheard_ns;
            frame.from == number && gap_ns + TICK_NS < silence_ns && !is_pause && !unheard
        };
        (1..frames.len()).filter(hasty).map(|index| frames[index].clone()).collect()
    }

    /// How long anybody has been sending, in total.
    pub fn busy(&self) -> Duration {
        Duration::from_nanos(self.0.borrow().record.busy_ns)
    }

    /// Characters that overlapped with those of another end.
    pub fn collisions(&self) -> u64 {
        self.0.borrow().record.collisions
    }
}

impl Bus {
    /// The number of the first character that has not been heard yet.
    fn first_unheard(&self) -> u64 {
        let now = now_ns();
        self.first + self.characters.partition_point(|character| character.end_ns <= now) as u64
    }

    /// The characters that `end` hears from its place on, future ones included, with their numbers.
    fn audible_from(&self, end: usize) -> impl Iterator<Item = (u64, &Character)> {
        self.audible(end, self.ends[end].next)
    }

    /// The same from the character number `next` on.
    fn audible(&self, end: usize, next: u64) -> impl Iterator<Item = (u64, &Character)> {
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
    fn read(&mut self, end: usize, into: &mut [u8]) -> usize {
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
    fn frame_from(&self, end: usize, silence: Silence) -> (Heard, u64) {
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
    fn transmit(&mut self, from: usize, bytes: &[u8], flaw: Option<Flaw>) {
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
    fn heard_as(&self, character: &Character, end: usize) -> (u8, Option<Flaw>) {
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
    fn set_line(&mut self, line: LineSettings) {
        self.line = line;
        self.run = Run { start_ns: self.run.end_ns, characters: 0, end_ns: self.run.end_ns };
    }

    fn wait(&mut self, context: &Context<'_>) {
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

#[cfg(test)]
mod tests;
