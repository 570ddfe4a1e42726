//! A Modbus request of the MainDevice, of any function (2033h): the port sends it as its own, by the rules for its name.
//!
//! One is open at a time. Its response, or why there is none, stays until the next one.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use ethercat_subdevice::coe::abort::Abort;
use heapless::Vec;

use crate::modbus::PDU_BYTES_MAX;
use crate::modbus::pdu::EXCEPTION_BIT;
use crate::scanner::{ErrorCode, Pdu};

/// Bytes of a request: the unit, and the PDU.
pub const REQUEST_BYTES_MAX: usize = 1 + PDU_BYTES_MAX;

/// How the request is doing: 2033h:02, in the numbers of 1023h (CiA 301, 7.5.2.20).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum RequestState {
    /// There was none, or nobody answers it: it went to everybody.
    Ended = 0,
    /// The response is there.
    Answered = 1,
    /// It ended in an error.
    Failed = 2,
    /// The response is there, and is an exception.
    Exception = 3,
    /// It waits for being sent.
    Waiting = 254,
    /// It is on its way.
    Open = 255,
}

impl RequestState {
    /// The number that the MainDevice reads.
    pub const fn number(self) -> u8 {
        match self {
            // From its side both are one.
            Self::Waiting => Self::Open as u8,
            state => state as u8,
        }
    }
}

/// Where requests and answers change hands.
pub struct Requests {
    current: Mutex<CriticalSectionRawMutex, RefCell<Current>>,
    asked: Signal<CriticalSectionRawMutex, ()>,
}

struct Current {
    state: RequestState,
    error: u8,
    /// Unit and PDU until it is sent; then the response's PDU.
    bytes: Vec<u8, REQUEST_BYTES_MAX>,
    /// They are parts of the next request.
    parts: bool,
}

impl Current {
    const fn new(state: RequestState, bytes: Vec<u8, REQUEST_BYTES_MAX>) -> Self {
        Self { state, error: 0, bytes, parts: false }
    }
}

impl Requests {
    pub(super) const fn new() -> Self {
        let current = Current::new(RequestState::Ended, Vec::new());
        Self { current: Mutex::new(RefCell::new(current)), asked: Signal::new() }
    }

    fn with<R>(&self, f: impl FnOnce(&mut Current) -> R) -> R {
        self.current.lock(|current| f(&mut current.borrow_mut()))
    }

    /// How the last one is doing.
    pub(super) fn state(&self) -> RequestState {
        self.with(|current| current.state)
    }

    /// Why it failed, in the numbers of [`ErrorCode`]; 0 if it has not.
    pub(super) fn error(&self) -> u8 {
        self.with(|current| current.error)
    }

    /// Whether `request` may be sent now.
    pub(super) fn check(&self, request: &[u8]) -> Result<(), Abort> {
        let [_, function, ..] = *request else { return Err(Abort::TooShort) };
        self.check_part()?;
        // 0 is no function, and the codes from 128 on are exceptions (Application Protocol, 4.1).
        if (1..EXCEPTION_BIT).contains(&function) { Ok(()) } else { Err(Abort::Range) }
    }

    /// Has `request`, which was checked, sent.
    pub(super) fn ask(&self, request: &[u8]) {
        self.with(|current| {
            let bytes = Vec::from_slice(request).unwrap_or_default();
            *current = Current::new(RequestState::Waiting, bytes);
        });
        self.asked.signal(());
    }

    /// Whether parts of the next request may be written now.
    pub fn check_part(&self) -> Result<(), Abort> {
        let busy = matches!(self.state(), RequestState::Waiting | RequestState::Open);
        if busy { Err(Abort::State) } else { Ok(()) }
    }

    /// Takes four bytes of the next request, from the byte `first` on; what came of the last one is forgotten.
    pub fn put_part(&self, first: usize, part: &[u8]) {
        self.with(|current| {
            if !current.parts {
                *current = Current { parts: true, ..Current::new(RequestState::Ended, Vec::new()) };
            }
            let end = (first + part.len()).clamp(current.bytes.len(), REQUEST_BYTES_MAX);
            // There is room for that.
            let _ = current.bytes.resize(end, 0);
            let shared = current.bytes.get_mut(first..).unwrap_or_default();
            shared.iter_mut().zip(part).for_each(|(shared, byte)| *shared = *byte);
        });
    }

    /// The first bytes of the parts, if there are so many.
    pub fn parts(&self, bytes: usize) -> Option<Vec<u8, REQUEST_BYTES_MAX>> {
        self.with(|current| {
            let parts = current.bytes.get(..bytes).filter(|_| current.parts)?;
            Vec::from_slice(parts).ok()
        })
    }

    /// Copies the response's PDU, and gives its length.
    pub(super) fn copy_response(&self, into: &mut [u8]) -> usize {
        self.with(|current| {
            let there = matches!(current.state, RequestState::Answered | RequestState::Exception);
            let answer = if there { &current.bytes[..] } else { &[] };
            into.iter_mut().zip(answer).for_each(|(shared, byte)| *shared = *byte);
            answer.len().min(into.len())
        })
    }

    /// Waits until one is to be sent.
    pub async fn asked(&self) {
        self.asked.wait().await;
    }

    /// Whether one is to be sent.
    pub fn waits(&self) -> bool {
        self.state() == RequestState::Waiting
    }

    /// Takes the one that is to be sent: its unit and PDU.
    pub fn take(&self) -> Option<(u8, Pdu)> {
        self.with(|current| {
            let (&unit, pdu) =
                current.bytes.split_first().filter(|_| current.state == RequestState::Waiting)?;
            let pdu = Pdu::from_slice(pdu).ok()?;
            current.state = RequestState::Open;
            // Whom a response comes from matters no more; that there was a broadcast does.
            current.bytes.truncate(1);
            Some((unit, pdu))
        })
    }

    /// What came of it: the response's PDU, or why there is none.
    pub fn ended(&self, outcome: Result<&[u8], ErrorCode>) {
        self.with(|current| {
            let broadcast = current.bytes.first() == Some(&0);
            current.bytes.clear();
            (current.state, current.error) = match outcome {
                Ok(answer) => {
                    let exception = answer.first().is_some_and(|function| function & EXCEPTION_BIT != 0);
                    // A PDU fits.
                    let _ = current.bytes.extend_from_slice(answer);
                    (if exception { RequestState::Exception } else { RequestState::Answered }, 0)
                }
                // Whom nobody answers was heard, as far as anybody can tell (Serial Line, 2.1).
                Err(ErrorCode::Unknown) if broadcast => (RequestState::Ended, 0),
                Err(error) => (RequestState::Failed, error as u8),
            };
        });
    }

    /// The response to what was sent will not come any more.
    pub fn lost(&self) {
        if self.state() == RequestState::Open {
            self.ended(Err(ErrorCode::Unknown));
        }
    }
}
