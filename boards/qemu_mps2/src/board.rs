//! The console's interface to the board, and the default settings.

use core::fmt::Write;

use cortex_m::peripheral::SCB;
use embassy_futures::block_on;
use embassy_futures::join::join;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use heapless::String;
use mobgate::console::{self, Mode};
use mobgate::gateway::Gateway;
use mobgate::gateway::reconfigure;
use mobgate::hal::{NetworkState, NoUpdate, System};
use mobgate::language::{LineBuffer, Loader};
use mobgate_board::last_words::WORDS_BYTES_MAX;
use mobgate_flash::{FlashStore, Image, SharedStore};
use mobgate_net::{Sockets, address};
#[cfg(feature = "users")] // As their feature.
use mobgate_passwords::Passwords;
use static_cell::StaticCell;

use crate::faults;
use crate::flash::FileFlash;
use crate::gateway::GATEWAY;
use crate::lines::CONSOLE;
use crate::names;
use crate::semihosting::{self, CommandLine};
use crate::uart::{DIVISOR_MIN, Line};

/// Settings while none are saved: each line has its own range of units.
const FIRST_SETTINGS: &str = "\
port P1   serial uart1 rtu client 115200 8N1 timeout 300ms
port P2   serial uart2 rtu client 115200 8N1 timeout 300ms
port P3   serial uart3 rtu client 115200 8N1 timeout 300ms
port P502 tcp server 502
route P502 1-64    * * P1
route P502 65-128  * * P2
route P502 129-247 * * P3
";

/// The emulator has no boot loader.
pub(crate) const NO_UPDATE: NoUpdate = NoUpdate("QEMU starts the image that it is given");

/// Storage of the settings.
pub(crate) type Store = SharedStore<'static, NoopRawMutex, FileFlash>;

/// Opens the store and applies the saved settings, or the default ones.
pub(crate) fn load(gateway: &Gateway<'_>) -> Store {
    static STORE: StaticCell<Mutex<NoopRawMutex, FlashStore<FileFlash>>> = StaticCell::new();
    let flash = FileFlash::open().expect("a file for the flash: see boards/qemu_mps2/emulate");
    let store = block_on(FlashStore::open(flash, 0, Image::ONLY));
    let mut store = SharedStore::new(STORE.init(Mutex::new(store)));
    match block_on(reconfigure::load(gateway, &mut store, &|_| Ok(()))) {
        Ok(1..) => return store,
        Ok(0) => {}
        Err(error) => log::error!("{error}"),
    }
    let mut draft = block_on(reconfigure::draft(gateway));
    let mut line = LineBuffer::default();
    let mut loader = Loader::new(&mut draft, &mut line);
    let loaded = loader.feed(FIRST_SETTINGS.as_bytes()).and_then(|()| loader.finish());
    loaded.expect("lines of the language");
    gateway.apply(&draft).expect("ports that this board has");
    store
}

// As their feature.
#[cfg(feature = "users")]
static PASSWORDS: static_cell::ConstStaticCell<Passwords> =
    static_cell::ConstStaticCell::new(Passwords::new());

pub(crate) struct Board {
    sockets: &'static Sockets,
    /// Why the last run ended, if it was a fault.
    last_words: Option<String<WORDS_BYTES_MAX>>,
    // As their feature.
    #[cfg(feature = "users")]
    passwords: &'static Passwords,
}

impl Board {
    /// The board after a start. The word `fault` on the command line triggers a fault, once.
    pub(crate) fn new(sockets: &'static Sockets) -> Self {
        let last_words = mobgate_faults::take();
        if last_words.is_none() && CommandLine::read().has("fault") {
            faults::touch_nothing();
        }
        GATEWAY.audit_start("started by power or a reset", last_words.as_deref());
        Self {
            sockets,
            last_words,
            #[cfg(feature = "users")]
            passwords: PASSWORDS.take(),
        }
    }
}

impl System for Board {
    fn name(&self) -> &str {
        "QEMU mps2-an386"
    }

    fn network(&self) -> Option<NetworkState> {
        Some(address::state(self.sockets.stack()))
    }

    fn write_event(&self, n: usize, out: &mut dyn Write) -> Option<core::fmt::Result> {
        let words = self.last_words.as_ref().filter(|_| n == 0)?;
        Some(write!(out, "the last run ended: {words}"))
    }

    fn write_serial_line(&self, n: usize, out: &mut dyn Write) -> Option<core::fmt::Result> {
        Some(out.write_str(names::name(n)?))
    }

    // As their feature.
    #[cfg(feature = "users")]
    async fn is_password(&self, hash: Option<&str>, password: &str) -> bool {
        self.passwords.is_right(hash, password)
    }

    #[cfg(feature = "users")]
    async fn hash_password(&self, password: &str) -> Option<mobgate::settings::PasswordHash> {
        self.passwords.hash(password, |salt| self.random(salt))
    }

    /// The host's.
    fn random(&self, into: &mut [u8]) -> bool {
        semihosting::random(into).is_ok()
    }

    fn reboot(&self) {
        SCB::sys_reset();
    }
}

/// Serves the terminal on UART 0, and saves the settings when an EtherCAT MainDevice requests it; never returns.
pub(crate) async fn console(gateway: &Gateway<'_>, mut store: Store, board: &Board) {
    let mut line = Line::open(CONSOLE, DIVISOR_MIN);
    let mut kept = store.another();
    let mut update = NO_UPDATE;
    let sessions = async {
        loop {
            // After `exit` a new session begins: there is no shell to return to.
            let Ok(_) = console::run(gateway, &mut line, &mut store, &mut update, board, Mode::Echo).await;
        }
    };
    join(gateway.keep_settings(&mut kept), sessions).await;
}
