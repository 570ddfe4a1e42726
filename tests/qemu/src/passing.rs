//! Lines 2 and 3 of the board, between which frames are passed on while they arrive: a master on one, a device on the other.

use std::io::Read;
use std::os::unix::net::UnixStream;
use std::thread::sleep;
use std::time::Duration;

use mobgate_simulator::device::rtu;

use crate::cost::SETTLED;
use crate::{Bus, Console, Machine, bus};

/// Time of a character at 2400 baud, where this host keeps up with it, and a long frame takes much longer than the jitter of
/// reads that is allowed for.
const CHARACTER: Duration = Duration::from_micros(4_583);
/// The device.
const UNIT: u8 = 5;

/// The master.
pub(crate) struct Passing(UnixStream);

impl Passing {
    /// Sets the board up for it. The rules that it had stay behind this one.
    pub(crate) fn start(machine: &Machine, console: &mut Console) -> Self {
        for line in [
            "port P2 serial uart2 rtu server 2400 8E1",
            "port P3 serial uart3 rtu client 2400 8E1",
            "route P2 1-10 * * P3 cut on",
        ] {
            assert_eq!(console.run(line), "", "{line}");
        }
        let bus = Bus::new([UNIT]);
        bus.response_after(SETTLED);
        bus.pace(CHARACTER);
        machine.wire(3, &bus);
        let master = machine.uart(2);
        // What comes before the first silence on a line may be the end of something.
        sleep(4 * SETTLED);
        Self(master)
    }

    /// Lets the master have a response of so many bytes.
    pub(crate) fn ask(&mut self, pdu: &[u8], response_bytes: usize) {
        bus::send(&mut self.0, &rtu::frame(UNIT, pdu), CHARACTER).unwrap();
        self.0.read_exact(&mut vec![0; response_bytes]).unwrap();
    }

    /// Reads so many registers.
    pub(crate) fn read(&mut self, registers: u8) {
        self.ask(&[3, 0, 0, 0, registers], 5 + 2 * usize::from(registers));
    }
}
