//! CAN application protocol over EtherCAT: dispatches services by number, one file each (ETG.1000.6, clause 5.6).

pub mod abort;
pub mod emergency;
pub mod information;
pub mod sdo;
mod service;

use crate::application::Application;
use crate::catalogue::Catalogue;
use crate::dictionary::Dictionary;
use crate::mailbox::{MailboxError, Payload};
use emergency::Emergencies;
use information::Information;
use sdo::SdoServer;
use service::Service;

/// Bytes of the header before each service.
const HEADER_BYTES: usize = 2;

/// The state of all services.
#[derive(Debug, Default)]
pub struct Coe {
    sdo: SdoServer,
    information: Information,
    /// Errors to report.
    pub emergencies: Emergencies,
}

impl Coe {
    /// Takes a request. [`next`](Self::next) may return further messages.
    pub fn request<A: Application>(
        &mut self,
        payload: &[u8],
        dictionary: &mut Dictionary<'_, A>,
        room: usize,
    ) -> Result<Option<Payload>, MailboxError> {
        let (&[_, service], body) =
            payload.split_first_chunk::<HEADER_BYTES>().ok_or(MailboxError::SizeTooShort)?;
        match service >> 4 {
            service if service == Service::SdoRequest as u8 => {
                let body = body.split_first_chunk().ok_or(MailboxError::SizeTooShort)?;
                // A new request aborts an unfinished list.
                self.information = Information::default();
                Ok(self.sdo.request(body, dictionary, room - HEADER_BYTES))
            }
            service if service == Service::SdoInformation as u8 => {
                self.information.request(body, dictionary)?;
                Ok(self.information.next(room - HEADER_BYTES, &dictionary.catalogue()))
            }
            _ => Err(MailboxError::ServiceNotSupported),
        }
    }

    /// Whether a response is incomplete: its other messages come from [`next`](Self::next), and have priority.
    pub fn is_responding(&self) -> bool {
        self.information.is_responding()
    }

    /// Whether a write is in progress in the application: its response comes from [`written`](Self::written), and has priority.
    pub fn is_writing(&self) -> bool {
        self.sdo.is_writing()
    }

    /// The response to a pending write, once the application has completed it.
    pub fn written(&mut self, application: &mut impl Application) -> Option<Payload> {
        self.sdo.written(application)
    }

    /// Whether there is anything to send without a request.
    pub fn has_more(&self) -> bool {
        self.is_responding() || self.emergencies.is_pending()
    }

    /// The next message of a response, or an emergency.
    pub fn next<A: Application>(&mut self, room: usize, catalogue: &Catalogue<'_, A>) -> Option<Payload> {
        self.information.next(room - HEADER_BYTES, catalogue).or_else(|| self.emergencies.next())
    }
}
