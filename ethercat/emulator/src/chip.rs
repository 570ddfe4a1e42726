//! One ESC with all its parts, and its behaviour over time.

use std::cell::RefCell;
use std::rc::Rc;
use std::task::Waker;

use ethercat_description::sii;
use ethercat_subdevice::device::Device;

use crate::Nanos;
use crate::dc::Clock;
use crate::dc::latch::Latches;
use crate::dc::sync::{SyncLine, SyncUnit};
use crate::eeprom::Eeprom;
use crate::events::Events;
use crate::memory::Memory;
use crate::registers::*;
use crate::reset_sequence::ResetSequence;
use crate::sync_manager::SyncManagers;
use crate::watchdog::Watchdog;

/// The properties in which controller chips differ (II, 0000h to 0009h).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kind {
    /// Registers 0000h to 0003h: type, revision, build.
    pub identity: [u8; 4],
    /// Number of FMMUs.
    pub fmmus: u8,
    /// Number of SyncManagers.
    pub sync_managers: u8,
    /// Process data memory in KBytes.
    pub ram_kib: u8,
    /// Features (register 0008h).
    pub features: u16,
    /// Whether an EEPROM read returns eight bytes instead of four.
    pub eeprom_reads_eight: bool,
}

impl Kind {
    /// Microchip's chip with two PHYs, the smallest common one.
    pub const LAN9252: Self = Self {
        identity: [0xC0, 0x02, 0, 0],
        fmmus: 3,
        sync_managers: 4,
        ram_kib: 4,
        features: 0x01CC,
        eeprom_reads_eight: true,
    };
    /// An IP core with the largest memory of an ESC.
    pub const IP_CORE: Self = Self {
        identity: [0x04, 0x03, 0, 0],
        fmmus: 8,
        sync_managers: 8,
        ram_kib: 60,
        features: 0x01CC,
        eeprom_reads_eight: false,
    };
    /// Beckhoff's ASIC.
    pub const ET1100: Self = Self { identity: [0x11, 0, 0x02, 0], ram_kib: 8, ..Self::IP_CORE };
}

/// A chip shared by frames and the processor.
pub type SharedChip = Rc<RefCell<Chip>>;

/// A controller chip with its EEPROM.
#[derive(Debug)]
pub struct Chip {
    pub(crate) kind: Kind,
    pub(crate) memory: Memory,
    pub(crate) managers: SyncManagers,
    pub(crate) events: Events,
    pub(crate) clock: Clock,
    pub(crate) sync: SyncUnit,
    pub(crate) latches: Latches,
    pub(crate) process_watchdog: Watchdog,
    pub(crate) pdi_watchdog: Watchdog,
    pub(crate) ports: [bool; 4],
    pub(crate) ecat_reset: ResetSequence,
    pub(crate) pdi_reset: ResetSequence,
    /// The EEPROM; the chip sees changes at its next reset or command.
    pub eeprom: Eeprom,
    /// When the last frame ends.
    pub(crate) frame_end: Nanos,
    /// SyncManagers that the processor is switching off, and when.
    pub(crate) switching_off: Vec<(u16, Nanos)>,
    waiting: Vec<Waker>,
}

impl Chip {
    /// A chip after power-on, with this EEPROM content.
    pub fn new(kind: Kind, eeprom: Vec<u8>) -> Self {
        let mut chip = Self {
            kind,
            memory: Memory::new(usize::from(PROCESS_RAM) + usize::from(kind.ram_kib) * 1024),
            managers: SyncManagers::new(&Memory::new(usize::from(PROCESS_RAM)), kind.sync_managers),
            events: Events::default(),
            clock: Clock::default(),
            sync: SyncUnit::default(),
            latches: Latches::default(),
            process_watchdog: Watchdog::of_process_data(),
            pdi_watchdog: Watchdog::of_pdi(),
            ports: [true, false, false, false],
            ecat_reset: ResetSequence::default(),
            pdi_reset: ResetSequence::default(),
            eeprom: Eeprom::new(eeprom, kind.eeprom_reads_eight),
            frame_end: 0,
            switching_off: Vec::new(),
            waiting: Vec::new(),
        };
        chip.reset();
        chip
    }

    /// A shared LAN9252 whose EEPROM describes `device`.
    ///
    /// # Panics
    /// If the device's description does not fit into the EEPROM.
    pub fn of(device: &Device) -> SharedChip {
        Rc::new(RefCell::new(Self::with_sii(Kind::LAN9252, device)))
    }

    /// A chip whose EEPROM describes `device`.
    ///
    /// # Panics
    /// If the device's description does not fit into the EEPROM.
    pub fn with_sii(kind: Kind, device: &Device) -> Self {
        let mut eeprom = [0; sii::SII_BYTES];
        sii::write(device, &mut eeprom).expect("the description fits");
        Self::new(kind, eeprom.to_vec())
    }

    /// Sets the chip's clock (I, Distributed Clocks) to `start` at world time 0, and makes it run faster than world time by
    /// `drift_ppm`.
    pub fn set_clock(&mut self, start: Nanos, drift_ppm: i64) {
        self.clock.start = start;
        self.clock.drift_ppm = drift_ppm;
    }

    /// The content of a register or memory byte, without side effects. Computed registers show their value as of the last access or
    /// frame.
    pub fn peek<const N: usize>(&self, address: u16) -> [u8; N] {
        self.memory.bytes(address)
    }

    /// SYNC0 pulses since the SYNC unit was activated (I, Distributed Clocks, "SyncSignals"; II, 0981h).
    pub fn sync0_pulses(&self) -> u64 {
        self.sync.pulses(SyncLine::Sync0)
    }

    /// All pulses at the pin of `line`, and when the last one began. None, if the EEPROM makes the pin an input.
    pub fn pulses_at_pin(&self, line: SyncLine) -> Option<(u64, Nanos)> {
        let is_output = self.memory.byte(PDI_CONFIG + 1) & line.is_output() != 0;
        Some(self.sync.at_pin(line)).filter(|(count, _)| is_output && *count > 0)
    }

    /// Sets the level of the pin LATCH0 or LATCH1, in place of which a chip has the SYNC signal of that number if the EEPROM says so
    /// (I, Distributed Clocks, "LatchSignals"; II, 09A8h to 09CFh).
    ///
    /// # Panics
    /// If `nth` is greater than 1.
    pub fn set_latch(&mut self, nth: usize, level: bool, at: Nanos) {
        self.advance(at);
        let time = self.clock.system(&self.memory, at);
        self.latches.set(&mut self.memory, nth, level, time);
        self.refresh(at);
        self.wake();
    }

    /// Performs everything due by `at`, and updates the computed registers.
    pub fn advance(&mut self, at: Nanos) {
        if self.process_watchdog.advance(&mut self.memory, at) {
            self.events.watchdog = true;
        }
        self.pdi_watchdog.advance(&mut self.memory, at);
        self.switch_off(at);
        let time = self.clock.system(&self.memory, at);
        self.sync.advance(&self.memory, time, at);
        if let Some(config) = self.eeprom.advance(&mut self.memory, at) {
            self.configure(&config);
        }
        self.refresh(at);
    }

    /// When the chip next changes without an access.
    pub fn next_change(&self, at: Nanos) -> Option<Nanos> {
        let others = [self.process_watchdog.next(), self.pdi_watchdog.next(), self.eeprom.next()];
        let switching = self.switching_off.iter().map(|(_, due)| Some(*due));
        others.into_iter().chain(switching).chain([self.next_sync(at)]).flatten().min()
    }

    /// World time of the next change of a SYNC signal; rather early than late if the clock drifts.
    fn next_sync(&self, at: Nanos) -> Option<Nanos> {
        let time = self.clock.system(&self.memory, at);
        self.sync.next().map(|next| at.saturating_add(next.saturating_sub(time)))
    }

    /// Registers `waker` for the next frame or access.
    pub fn wake_at_change(&mut self, waker: &Waker) {
        if !self.waiting.iter().any(|known| known.will_wake(waker)) {
            self.waiting.push(waker.clone());
        }
    }

    pub(crate) fn wake(&mut self) {
        self.waiting.drain(..).for_each(Waker::wake);
    }
}
