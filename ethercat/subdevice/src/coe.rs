//! CAN application protocol over EtherCAT: services by their number, each in a file of its own (ETG.1000.6, clause 5.6).

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

/// Bytes of the header in front of each service.
const HEADER_BYTES: usize = 2;

/// All services' state.
#[derive(Debug, Default)]
pub struct Coe {
    sdo: SdoServer,
    information: Information,
    /// Errors that are to be reported.
    pub emergencies: Emergencies,
}

impl Coe {
    /// Takes a request. Its answer is what [`next`](Self::next) gives.
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
                // Who asks for something else has no use for the rest of a list.
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

    /// Whether an answer is not complete: its other messages come by [`next`](Self::next), and go first.
    pub fn is_responding(&self) -> bool {
        self.information.is_responding()
    }

    /// Whether a write goes on in the application: its answer comes by [`written`](Self::written), and goes first.
    pub fn is_writing(&self) -> bool {
        self.sdo.is_writing()
    }

    /// The answer to a write that went on, if the application has ended it.
    pub fn written(&mut self, application: &mut impl Application) -> Option<Payload> {
        self.sdo.written(application)
    }

    /// Whether there is anything to send without being asked again.
    pub fn has_more(&self) -> bool {
        self.is_responding() || self.emergencies.is_pending()
    }

    /// The next message of an answer, or an emergency.
    pub fn next<A: Application>(&mut self, room: usize, catalogue: &Catalogue<'_, A>) -> Option<Payload> {
        self.information.next(room - HEADER_BYTES, catalogue).or_else(|| self.emergencies.next())
    }
}
