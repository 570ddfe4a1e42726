//! A Modbus request of the MainDevice with any function (2033h): the port sends it as its own, by the rules for its name.
//!
//! At most one is pending. Its response or error stays until the next one.

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

/// Progress of the request: 2033h:02, coded as 1023h (CiA 301, 7.5.2.20).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum RequestState {
    /// No request, or a broadcast, which has no response.
    Ended = 0,
    /// The response has arrived.
    Answered = 1,
    /// The request failed.
    Failed = 2,
    /// The response is an exception.
    Exception = 3,
    /// Waits to be sent.
    Waiting = 254,
    /// Sent.
    Open = 255,
}

impl RequestState {
    /// The code for the MainDevice.
    pub const fn number(self) -> u8 {
        match self {
            // The MainDevice sees no difference.
            Self::Waiting => Self::Open as u8,
            state => state as u8,
        }
    }
}

/// Passes requests to the port, and responses back.
pub struct Requests {
    current: Mutex<CriticalSectionRawMutex, RefCell<Current>>,
    asked: Signal<CriticalSectionRawMutex, ()>,
}

struct Current {
    state: RequestState,
    error: u8,
    /// Unit and PDU until sent; then the response's PDU.
    bytes: Vec<u8, REQUEST_BYTES_MAX>,
    /// The bytes are parts of the next request.
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

    /// The progress of the last request.
    pub(super) fn state(&self) -> RequestState {
        self.with(|current| current.state)
    }

    /// Why it failed, as an [`ErrorCode`] number; 0 if it did not.
    pub(super) fn error(&self) -> u8 {
        self.with(|current| current.error)
    }

    /// Checks whether `request` may be sent now.
    pub(super) fn check(&self, request: &[u8]) -> Result<(), Abort> {
        let [_, function, ..] = *request else { return Err(Abort::TooShort) };
        self.check_part()?;
        // 0 is no function, and the codes from 128 on are exceptions (Application Protocol, 4.1).
        if (1..EXCEPTION_BIT).contains(&function) { Ok(()) } else { Err(Abort::Range) }
    }

    /// Queues the checked `request` for sending.
    pub(super) fn ask(&self, request: &[u8]) {
        self.with(|current| {
            let bytes = Vec::from_slice(request).unwrap_or_default();
            *current = Current::new(RequestState::Waiting, bytes);
        });
        self.asked.signal(());
    }

    /// Checks whether parts of the next request may be written now.
    pub fn check_part(&self) -> Result<(), Abort> {
        let busy = matches!(self.state(), RequestState::Waiting | RequestState::Open);
        if busy { Err(Abort::State) } else { Ok(()) }
    }

    /// Stores a part of the next request at byte `first`; discards the result of the last one.
    pub fn put_part(&self, first: usize, part: &[u8]) {
        self.with(|current| {
            if !current.parts {
                *current = Current { parts: true, ..Current::new(RequestState::Ended, Vec::new()) };
            }
            let end = (first + part.len()).clamp(current.bytes.len(), REQUEST_BYTES_MAX);
            // Within the capacity.
            let _ = current.bytes.resize(end, 0);
            let shared = current.bytes.get_mut(first..).unwrap_or_default();
            shared.iter_mut().zip(part).for_each(|(shared, byte)| *shared = *byte);
        });
    }

    /// The first bytes of the parts, if there are that many.
    pub fn parts(&self, bytes: usize) -> Option<Vec<u8, REQUEST_BYTES_MAX>> {
        self.with(|current| {
            let parts = current.bytes.get(..bytes).filter(|_| current.parts)?;
            Vec::from_slice(parts).ok()
        })
    }

    /// Copies the response's PDU, and returns its length.
    pub(super) fn copy_response(&self, into: &mut [u8]) -> usize {
        self.with(|current| {
            let there = matches!(current.state, RequestState::Answered | RequestState::Exception);
            let response = if there { &current.bytes[..] } else { &[] };
            into.iter_mut().zip(response).for_each(|(shared, byte)| *shared = *byte);
            response.len().min(into.len())
        })
    }

    /// Waits until a request is queued.
    pub async fn asked(&self) {
        self.asked.wait().await;
    }

    /// Whether a request is queued.
    pub fn waits(&self) -> bool {
        self.state() == RequestState::Waiting
    }

    /// Takes the queued request: its unit and PDU.
    pub fn take(&self) -> Option<(u8, Pdu)> {
        self.with(|current| {
            let (&unit, pdu) =
                current.bytes.split_first().filter(|_| current.state == RequestState::Waiting)?;
            let pdu = Pdu::from_slice(pdu).ok()?;
            current.state = RequestState::Open;
            // Only the unit is still needed, to recognise a broadcast.
            current.bytes.truncate(1);
            Some((unit, pdu))
        })
    }

    /// Records the outcome: the response's PDU, or why there is none.
    pub fn ended(&self, outcome: Result<&[u8], ErrorCode>) {
        self.with(|current| {
            let broadcast = current.bytes.first() == Some(&0);
            current.bytes.clear();
            (current.state, current.error) = match outcome {
                Ok(response) => {
                    let exception = response.first().is_some_and(|function| function & EXCEPTION_BIT != 0);
                    // A PDU fits.
                    let _ = current.bytes.extend_from_slice(response);
                    (if exception { RequestState::Exception } else { RequestState::Answered }, 0)
                }
                // A broadcast without response counts as successful (Serial Line, 2.1).
                Err(ErrorCode::Unknown) if broadcast => (RequestState::Ended, 0),
                Err(error) => (RequestState::Failed, error as u8),
            };
        });
    }

    /// Records that the response to a sent request will not arrive.
    pub fn lost(&self) {
        if self.state() == RequestState::Open {
            self.ended(Err(ErrorCode::Unknown));
        }
    }
}
