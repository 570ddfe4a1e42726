//! The bench's application: stores written values, and records process data.

use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

use embassy_time::Instant;
use ethercat_subdevice::al_state::{AlState, AlStatusCode};
use ethercat_subdevice::application::{Address, Application};
use ethercat_subdevice::assignment::Assignment;
use ethercat_subdevice::coe::abort::Abort;
use ethercat_subdevice::coe::emergency::Emergency;
use ethercat_subdevice::eoe::{Eoe, Ethernet};
use ethercat_subdevice::esc::EscError;
use ethercat_subdevice::foe::{FileError, Files, Opening};
use ethercat_subdevice::indicators::Indicators;
use ethercat_subdevice::mailbox::{MailboxError, Payload};
use ethercat_subdevice::object::Object;
use ethercat_subdevice::sync_manager::Channel;

use super::ethernet::BenchLink;
use super::files::BenchFiles;

/// Methods that only call the shared application's.
macro_rules! pass_on {
    ($(fn $name:ident(&mut $this:ident $(, $value:ident: $of:ty)*) $(-> $result:ty)?;)*) => {
        $(fn $name(&mut $this $(, $value: $of)*) $(-> $result)? {
            $this.0.borrow_mut().$name($($value),*)
        })*
    };
    ($(fn $name:ident(&$this:ident $(, $value:ident: $of:ty)*) -> $result:ty;)*) => {
        $(fn $name(&$this $(, $value: $of)*) -> $result {
            $this.0.borrow().$name($($value),*)
        })*
    };
}

/// An application that a test can inspect while the SubDevice uses it.
#[derive(Debug, Default)]
pub struct Shared<A>(pub Rc<RefCell<A>>);

impl<A> Shared<A> {
    /// Shares `application`.
    pub fn new(application: A) -> Self {
        Self(Rc::new(RefCell::new(application)))
    }
}

impl<A> Clone for Shared<A> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<A: Application> Application for Shared<A> {
    fn files(&mut self) -> Option<&mut impl Files> {
        let has_files = self.0.borrow_mut().files().is_some();
        has_files.then_some(self)
    }

    fn ethernet(&mut self) -> Option<&mut impl Ethernet> {
        let has_ethernet = self.0.borrow_mut().ethernet().is_some();
        has_ethernet.then_some(self)
    }

    pass_on! {
        fn proves_outputs(&self) -> bool;
        fn sends_emergencies(&self) -> bool;
        fn identification(&self) -> Option<u16>;
        fn object(&self, index: u16) -> Option<Object>;
        fn next_object(&self, index: u16) -> Option<u16>;
        fn assignment(&self, channel: Channel) -> Option<Assignment>;
        fn cycle_fixed_ns(&self) -> u32;
        fn is_another_device(&self) -> bool;
    }

    pass_on! {
        fn read(&mut self, at: Address, into: &mut [u8]) -> Result<usize, Abort>;
        fn check(&mut self, at: Address, value: &[u8]) -> Result<(), Abort>;
        fn write(&mut self, at: Address, value: &[u8]);
        fn written(&mut self) -> Option<Result<(), Abort>>;
        fn shows(&mut self, indicators: Indicators);
        fn emergency(&mut self) -> Option<Emergency>;
        fn assigned(&mut self, channel: Channel, pdos: &[u16]);
        fn outputs(&mut self, pdo: u16, bytes: &[u8]);
        fn inputs(&mut self, pdo: u16, into: &mut [u8]);
        fn outputs_stopped(&mut self);
        fn failed(&mut self, fault: EscError);
        fn may_enter(&mut self, state: AlState) -> Result<(), AlStatusCode>;
        fn memory_full(&mut self, channel: Channel, bytes: u16, room: u16);
        fn entered(&mut self, state: AlState);
    }
}

impl<A: Application> Files for Shared<A> {
    fn open(&mut self, opening: &Opening<'_>) {
        if let Some(files) = self.0.borrow_mut().files() {
            files.open(opening);
        }
    }

    fn write(&mut self, bytes: &[u8]) {
        if let Some(files) = self.0.borrow_mut().files() {
            files.write(bytes);
        }
    }

    fn finish(&mut self) {
        if let Some(files) = self.0.borrow_mut().files() {
            files.finish();
        }
    }

    fn done(&mut self) -> Option<Result<(), FileError>> {
        self.0.borrow_mut().files()?.done()
    }

    fn read(&mut self, into: &mut [u8]) -> Option<Result<usize, FileError>> {
        self.0.borrow_mut().files()?.read(into)
    }

    fn abort(&mut self) {
        if let Some(files) = self.0.borrow_mut().files() {
            files.abort();
        }
    }
}

impl<A: Application> Ethernet for Shared<A> {
    fn request(
        &mut self,
        payload: &[u8],
        room: usize,
        now: Instant,
    ) -> Result<Option<Payload>, MailboxError> {
        let mut application = self.0.borrow_mut();
        let ethernet = application.ethernet().ok_or(MailboxError::UnsupportedProtocol)?;
        ethernet.request(payload, room, now)
    }

    fn next(&mut self, room: usize) -> Option<Payload> {
        self.0.borrow_mut().ethernet()?.next(room)
    }

    fn is_sending(&mut self) -> bool {
        self.0.borrow_mut().ethernet().is_some_and(Ethernet::is_sending)
    }

    fn start(&mut self) {
        if let Some(ethernet) = self.0.borrow_mut().ethernet() {
            ethernet.start();
        }
    }
}

/// The application of the bench's devices.
#[derive(Default)]
pub struct Bench {
    /// Written values, by index and sub-index.
    pub values: HashMap<(u16, u8), Vec<u8>>,
    /// Number of writes.
    pub writes: usize,
    /// The last outputs.
    pub outputs: Vec<u8>,
    /// Number of output images.
    pub images: usize,
    /// How often outputs became invalid.
    pub stops: usize,
    /// The controller's faults.
    pub faults: Vec<EscError>,
    /// Fill value of inputs; it increments.
    pub fill: u8,
    /// Writes stay pending while this is set, and then end with an error if there is one.
    pub writing: bool,
    /// That error.
    pub write_error: Option<Abort>,
    /// Files, for the devices that have any.
    pub files: BenchFiles,
    /// Ethernet, for the devices that have it.
    pub ethernet: Eoe<BenchLink>,
    /// A state that the application refuses, with the code.
    pub refuses: Option<(AlState, AlStatusCode)>,
}

impl Application for Bench {
    fn read(&mut self, at: Address, into: &mut [u8]) -> Result<usize, Abort> {
        let Some(value) = self.values.get(&(at.index, at.sub)) else { return Ok(into.len()) };
        into[..value.len()].copy_from_slice(value);
        Ok(value.len())
    }

    fn check(&mut self, at: Address, value: &[u8]) -> Result<(), Abort> {
        // A value refused because of local control, to cover that abort code too.
        match (at.index, value) {
            (0x2106, [13, ..]) => Err(Abort::LocalControl),
            _ => Ok(()),
        }
    }

    fn write(&mut self, at: Address, value: &[u8]) {
        self.writes += 1;
        self.values.insert((at.index, at.sub), value.to_vec());
    }

    fn written(&mut self) -> Option<Result<(), Abort>> {
        let outcome = self.write_error.map_or(Ok(()), Err);
        (!self.writing).then_some(outcome)
    }

    fn files(&mut self) -> Option<&mut impl Files> {
        Some(&mut self.files)
    }

    fn ethernet(&mut self) -> Option<&mut impl Ethernet> {
        Some(&mut self.ethernet)
    }

    fn outputs(&mut self, _pdo: u16, bytes: &[u8]) {
        self.outputs = bytes.to_vec();
        self.images += 1;
    }

    fn inputs(&mut self, _pdo: u16, into: &mut [u8]) {
        self.fill = self.fill.wrapping_add(1);
        into.fill(self.fill);
    }

    fn outputs_stopped(&mut self) {
        self.stops += 1;
    }

    fn failed(&mut self, fault: EscError) {
        self.faults.push(fault);
    }

    fn may_enter(&mut self, state: AlState) -> Result<(), AlStatusCode> {
        match self.refuses {
            Some((refused, code)) if refused == state => Err(code),
            _ => Ok(()),
        }
    }
}
