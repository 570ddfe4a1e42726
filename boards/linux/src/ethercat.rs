//! The gateway as an EtherCAT SubDevice at a network interface, with a software controller that processes the interface's frames.
//!
//! The path of a frame: epoll, [`reactor`](crate::reactor), `pass_frames`, through the controller, and back out of the interface.
//! Its effects wake the SubDevice, which accesses the controller directly. To the SubDevice a missing or lost interface is a chip
//! that does not respond: it retries until it does.

use std::cell::Cell;
use std::io::{self, ErrorKind};
use std::rc::Rc;

use embassy_futures::join::join4;
use embassy_futures::select::{Either3, select3};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embedded_hal_async::digital::Wait;
use ethercat_esc::frame::{FRAME_BYTES_MAX, is_whole};
use ethercat_esc::interface::{Interface, InterfaceError};
use ethercat_esc::{Chip, DirectPdi, Interrupt, Kind, SharedChip, SyncLine, SyncPin, now};
use ethercat_subdevice::clocks::SyncSignals;
use ethercat_subdevice::eoe::Eoe;
use ethercat_subdevice::esc::{Esc, EscError};
use mobgate::fieldbus::{EthercatState, FileBuffer, long_device, serve_long};
use mobgate::gateway::Gateway;
use mobgate::settings::{InterfaceName, PortId, PortKind};
use mobgate::stats::Event;
use rustix::io::Errno;

use crate::descriptor::Descriptor;
use crate::hint;
use crate::tap::TapLink;

/// Runs the SubDevice while the settings of `gateway` name a network interface for it, with its files in `files`; never returns.
pub async fn run(gateway: &Gateway<'_>, place: &EthercatState, files: &FileBuffer) -> ! {
    let link = Link {
        gateway,
        chip: Rc::new(controller_of((false, false)).into()),
        described: Cell::new((false, false)),
        fault: Cell::new(Some(NOT_OPEN)),
        opened: Signal::new(),
        lost: Signal::new(),
        tap: TapLink::default(),
    };
    let mut interrupt = Interrupt::new(link.chip.clone());
    let attention = async || {
        // The line is infallible.
        let _ = select3(interrupt.wait_for_high(), link.lost.wait(), link.tap.arrival()).await;
    };
    let controller = Controller { link: &link, pdi: DirectPdi::new(link.chip.clone()) };
    // One for each run of the program.
    let signals: &SyncSignals = Box::leak(Box::new(SyncSignals::new()));
    let sync0 = note(SyncPin::new(link.chip.clone(), SyncLine::Sync0), || signals.sync0());
    let sync1 = note(SyncPin::new(link.chip.clone(), SyncLine::Sync1), || signals.sync1());
    let ethernet = Eoe::new(&link.tap);
    let device = serve_long(place, gateway.scanner(), files, ethernet, controller, Some(signals), attention);
    let (never, ..) = join4(device, link.carry(), sync0, sync1).await;
    never
}

/// Calls `signal` at each pulse of a SYNC signal of the software controller.
async fn note(mut pin: SyncPin, signal: impl Fn()) -> ! {
    loop {
        pin.pulse().await;
        signal();
    }
}

/// Whether a SubDevice can run at interface `name`; if not, why and what to do.
pub fn check(name: &str) -> Result<(), &'static str> {
    Interface::open(name).map(|_| ()).map_err(|error| reason(name, &error))
}

/// The gateway's controller; its EEPROM describes the device with or without modules, and Ethernet.
fn controller_of((modules, ethernet): (bool, bool)) -> Chip {
    // The description is constant and covered by a test that reads it back.
    Chip::with_sii(Kind::IP_CORE, long_device(modules, ethernet))
}

/// Initial fault.
const NOT_OPEN: EscError = EscError::Unreachable("not opened yet");

/// What the settings ask for.
#[derive(PartialEq)]
struct Wanted {
    interface: InterfaceName,
    modules: bool,
    /// The TAP interface that carries a MainDevice's Ethernet frames.
    ethernet: Option<InterfaceName>,
}

/// The controller and its network interface.
struct Link<'g> {
    gateway: &'g Gateway<'g>,
    chip: SharedChip,
    /// Whether the EEPROM describes modules, and Ethernet.
    described: Cell<(bool, bool)>,
    /// Why no frames arrive; `None` while the interface is open.
    fault: Cell<Option<EscError>>,
    opened: Signal<NoopRawMutex, (Wanted, Descriptor<Interface>)>,
    lost: Signal<NoopRawMutex, ()>,
    tap: TapLink,
}

impl Link<'_> {
    /// What the settings ask for, if they name an interface.
    fn wanted(&self) -> Option<Wanted> {
        self.gateway.settings(|settings| {
            let port = settings.ethercat()?;
            let (interface, ethernet) = (port.interface.clone()?, port.ethernet.clone());
            Some(Wanted { interface, modules: port.modules, ethernet })
        })
    }

    /// Waits for the settings to name an interface.
    async fn named(&self) -> Wanted {
        loop {
            if let Some(wanted) = self.wanted() {
                return wanted;
            }
            self.tap.close();
            self.gateway.new_ethercat_interface().await;
        }
    }

    /// Opens the interfaces, and resets the controller.
    async fn open(&self) -> Result<(), EscError> {
        let wanted = self.named().await;
        let tap = self.tap.open(wanted.ethernet.as_deref());
        let opened = tap.and_then(|()| open_interface(&wanted.interface)).map_err(EscError::Unreachable);
        self.fault.set(opened.as_ref().err().copied());
        opened.map(|interface| {
            let device = (wanted.modules, wanted.ethernet.is_some());
            let mut chip = self.chip.borrow_mut();
            if self.described.replace(device) != device {
                chip.eeprom = controller_of(device).eeprom;
            }
            chip.reset();
            self.opened.signal((wanted, interface));
        })
    }

    /// Carries frames whenever the interface is open; never returns.
    async fn carry(&self) {
        loop {
            let (wanted, interface) = self.opened.wait().await;
            let ended = select3(self.pass_frames(interface), self.changed(&wanted), self.tap.lost()).await;
            let why = match ended {
                Either3::First(error) => reason(&wanted.interface, &fault_of(error)),
                Either3::Second(()) => "the settings name another interface, or device",
                Either3::Third(why) => why,
            };
            self.fault.set(Some(EscError::Unreachable(why)));
            self.lost.signal(());
        }
    }

    /// Waits until the settings ask for something else: another interface or none, or another device at it.
    async fn changed(&self, wanted: &Wanted) {
        while self.wanted().as_ref() == Some(wanted) {
            self.gateway.new_ethercat_interface().await;
        }
    }

    /// Passes frames from `interface` through the controller until an error.
    async fn pass_frames(&self, mut interface: Descriptor<Interface>) -> io::Error {
        let mut frame = [0; FRAME_BYTES_MAX];
        loop {
            let length = match interface.read_with(|interface| interface.receive(&mut frame)).await {
                Ok(length) => length,
                Err(error) => return error,
            };
            let frame = &mut frame[..length];
            if !is_whole(frame) {
                self.count(Event::Malformed);
            } else if self.chip.borrow_mut().pass(now(), frame)
                && let Err(error) = interface.write_with(|interface| interface.send(frame)).await
            {
                match Errno::from_io_error(&error) {
                    // The MainDevice detects lost frames.
                    Some(Errno::NOBUFS) => self.count(Event::Discarded),
                    _ => return error,
                }
            }
        }
    }

    /// Counts an event at the EtherCAT port.
    fn count(&self, event: Event) {
        let is_ethercat = |kind: &PortKind| matches!(kind, PortKind::Ethercat(_));
        let port = self.gateway.settings(|settings| {
            settings.ports.iter().position(|port| port.as_ref().is_some_and(|port| is_ethercat(&port.kind)))
        });
        if let Some(state) = port.and_then(|port| self.gateway.port_state(PortId(port as u8))) {
            state.stats.count(event);
        }
    }
}

/// The SubDevice's access to the controller.
struct Controller<'l> {
    link: &'l Link<'l>,
    pdi: DirectPdi,
}

impl Controller<'_> {
    fn check(&self) -> Result<(), EscError> {
        self.link.fault.get().map_or(Ok(()), Err)
    }
}

impl Esc for Controller<'_> {
    async fn read(&mut self, address: u16, into: &mut [u8]) -> Result<(), EscError> {
        self.check()?;
        self.pdi.read(address, into).await
    }

    async fn write(&mut self, address: u16, bytes: &[u8]) -> Result<(), EscError> {
        self.check()?;
        self.pdi.write(address, bytes).await
    }

    async fn events(&mut self) -> Result<u32, EscError> {
        self.check()?;
        self.pdi.events().await
    }

    async fn look(&mut self) -> Result<(), EscError> {
        match self.check() {
            Ok(()) => Ok(()),
            Err(_) => self.link.open().await,
        }
    }
}

/// Classifies an interface error: one that was removed may report the same error as one that is down.
fn fault_of(error: io::Error) -> InterfaceError {
    match error.kind() {
        ErrorKind::NetworkDown => InterfaceError::Down,
        _ => match Errno::from_io_error(&error) {
            Some(Errno::NODEV | Errno::NXIO) => InterfaceError::Missing,
            _ => InterfaceError::Failed(error),
        },
    }
}

fn open_interface(name: &str) -> Result<Descriptor<Interface>, &'static str> {
    let opened = Interface::open(name).and_then(|interface| Ok(Descriptor::new(interface)?));
    opened.map_err(|error| reason(name, &error))
}

/// Maps an error to a message for the user.
fn reason(name: &str, error: &InterfaceError) -> &'static str {
    hint::keep(match error {
        InterfaceError::Missing => format!("no network interface is called {name}: see ip link"),
        InterfaceError::NotEthernet => format!("{name} is not an Ethernet interface"),
        InterfaceError::Down => format!("the interface {name} is down: sudo ip link set {name} up"),
        InterfaceError::Denied => return hint::raw_socket_denied(),
        InterfaceError::Failed(error) => format!("the interface {name}: {error}"),
    })
}
