//! What transactions take by the formulas, in seconds; direct, stored, and passed on while they arrive.

use mobgate::settings::{Framing, LineSettings};
use mobgate_simulator::timing::{char_bits, t3_5_ns};

use super::{TICK, TURNAROUND, UNIT_FUNCTION_COUNT};

/// Unit, function, address and quantity of a request.
const REQUEST_BYTES: f64 = 6.0;

/// One line of a chain.
#[derive(Clone, Copy)]
pub(super) struct Line {
    pub(super) framing: Framing,
    pub(super) settings: LineSettings,
}

impl Line {
    /// An RTU line, 8E1.
    pub(super) fn rtu(baud: u32) -> Self {
        Self { framing: Framing::Rtu, settings: LineSettings { baud, ..LineSettings::DEFAULT } }
    }

    /// An ASCII line, 7E1.
    pub(super) fn ascii(baud: u32) -> Self {
        let settings = LineSettings { baud, data_bits: 7, ..LineSettings::DEFAULT };
        Self { framing: Framing::Ascii, settings }
    }

    /// The settings of a port on the line `device`.
    pub(super) fn port(self, device: &str, side: &str) -> String {
        let Self { framing, settings: LineSettings { baud, data_bits, .. } } = self;
        format!("serial {device} {framing} {side} {baud} {data_bits}E1")
    }

    /// Seconds of one character.
    pub(super) fn tc(self) -> f64 {
        char_bits(&self.settings) as f64 / f64::from(self.settings.baud)
    }

    /// The silence that the gateway keeps before a frame.
    pub(super) fn t3_5(self) -> f64 {
        t3_5_ns(&self.settings) as f64 / 1e9
    }

    /// The silence by which a frame's end is heard.
    fn end_silence(self) -> f64 {
        if self.framing == Framing::Rtu { self.t3_5() } else { 0.0 }
    }

    /// From the end of a request to its response, by a device on this line.
    pub(super) fn device(self) -> f64 {
        self.end_silence() + TURNAROUND
    }

    /// Characters of a frame of unit, function and data, `bytes` together.
    fn chars_of(self, bytes: f64) -> f64 {
        if self.framing == Framing::Rtu { bytes + 2.0 } else { 2.0 * bytes + 5.0 }
    }

    /// Characters of a request and its response.
    pub(super) fn chars(self, registers: u8) -> [f64; 2] {
        [REQUEST_BYTES, response_bytes(registers)].map(|bytes| self.chars_of(bytes))
    }

    /// The time of both.
    fn frames(self, registers: u8) -> f64 {
        self.chars(registers).iter().sum::<f64>() * self.tc()
    }
}

fn response_bytes(registers: u8) -> f64 {
    UNIT_FUNCTION_COUNT + 2.0 * f64::from(registers)
}

/// Tstd of `line`.
pub(super) fn direct(line: Line, registers: u8) -> f64 {
    line.frames(registers) + line.device()
}

/// The clock's tick at which `time` is over: a frame begins at a tick, and its first bit is one for those who time it.
fn ticked(time: f64) -> f64 {
    // What is a tick but for the last bits of a float is no later one.
    (time / TICK - 1e-6).ceil() * TICK
}

/// From the first bit of a frame of `bytes` bytes without its check to the last bit of its copy, which begins as soon as its
/// unit is there, or so late that it never waits: `max(r ti + Lo to, Li ti + h to)` of `mobgate::port::cut_through::timing`, from the next tick on.
fn leg(bytes: f64, input: Line, output: Line) -> f64 {
    let until_unit = if input.framing == Framing::Rtu { 1.0 } else { 3.0 };
    let held_back = match (input.framing, output.framing) {
        (_, Framing::Rtu) => 1.0,
        (Framing::Rtu, Framing::Ascii) => 4.0,
        (Framing::Ascii, Framing::Ascii) => 2.0,
    };
    let copy = output.chars_of(bytes) * output.tc();
    let never_waits = input.chars_of(bytes) * input.tc() + held_back * output.tc() - copy;
    ticked(never_waits.max(until_unit * input.tc())) + copy
}

/// The formula of cut-through from `up` to `down`. The response on the upper line keeps its distance from the request, which
/// the silence on a fast lower line does not give where the upper one is slow.
pub(super) fn cut_through(up: Line, down: Line, registers: u8) -> f64 {
    let there = leg(REQUEST_BYTES, up, down);
    let back = down.device() + leg(response_bytes(registers), down, up);
    let [request, response] = up.chars(registers).map(|chars| chars * up.tc());
    (there + back).max(ticked(request) + ticked(up.t3_5()) + response)
}

/// The formula of routers that wait for the silence behind every RTU frame, as MobGate does.
pub(super) fn store_and_forward(up: Line, down: Line, registers: u8) -> f64 {
    let silences = up.end_silence() + 2.0 * down.end_silence();
    up.frames(registers) + down.frames(registers) + silences + TURNAROUND
}
