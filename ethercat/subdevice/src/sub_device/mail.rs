//! Messages: takes one from SM0 when there is room for its response, and writes one to SM1 when that is empty.

use embassy_time::{Duration, Instant, Timer};

use super::{PDI_CONTROL_OFF, SubDevice};
use crate::application::Application;
use crate::catalogue::Catalogue;
use crate::coe::emergency::Emergency;
use crate::dictionary::Dictionary;
use crate::eoe::Ethernet;
use crate::esc::{Esc, EscError};
use crate::foe::FileAccess;
use crate::mailbox::{MAILBOX_BYTES_MAX, MailboxError, Payload, Protocol};
use crate::registers::Events;
use crate::sync_manager::Channel;

/// Polling interval and limit until a SyncManager is off: the longest frame takes 123 us.
const SWITCH_PAUSE: Duration = Duration::from_micros(20);
const SWITCH_LOOKS_MAX: usize = 50;

impl<E: Esc, A: Application, const OUTPUTS: usize, const INPUTS: usize> SubDevice<E, A, OUTPUTS, INPUTS> {
    /// Receives and sends messages; returns whether there were any.
    pub(super) async fn exchange_mail(&mut self, events: Events) -> Result<bool, EscError> {
        if !self.al.state().has_mailbox() {
            return Ok(false);
        }
        if events.any(Events::MAILBOX_FETCHED) {
            self.mailbox.fetched();
        }
        if let Some(files) = self.application.files() {
            self.foe.expire(files, Instant::now());
        }
        let ended = self.coe.written(&mut self.application);
        let written = ended.is_some();
        if let Some(response) = ended {
            self.mailbox.send(Protocol::CanOpen, response);
        }
        let taken = events.any(Events::MAILBOX_WRITTEN) && self.takes_requests();
        if taken {
            self.let_pulse_pass().await?;
            self.take_request().await?;
        }
        let given = self.give_message().await?;
        Ok(written || taken || given)
    }

    /// Whether a request may be taken: there is room for its response, and no earlier response is outstanding.
    pub(super) fn takes_requests(&self) -> bool {
        self.al.state().has_mailbox() && self.mailbox.has_room() && !self.coe.is_writing()
    }

    /// Whether something waits for SM1 to be read.
    pub(super) fn waits_for_mailbox(&mut self) -> bool {
        self.mailbox.is_occupied()
            && (!self.mailbox.is_idle()
                || self.coe.has_more()
                || self.foe.is_working()
                || self.ethernet().is_some_and(Ethernet::is_sending))
    }

    /// The application's Ethernet, where it is offered now.
    pub(super) fn ethernet(&mut self) -> Option<&mut impl Ethernet> {
        let offered = self.device.ethernet && self.al.state().has_objects();
        offered.then(|| self.application.ethernet()).flatten()
    }

    async fn take_request(&mut self) -> Result<(), EscError> {
        let mut buffer = [0; MAILBOX_BYTES_MAX];
        let bytes = usize::from(self.device.memory.mailbox_bytes);
        let mailbox = buffer.get_mut(..bytes).unwrap_or_default();
        self.esc.read(self.device.memory.start(Channel::MailboxOut), mailbox).await?;
        let Some(request) = self.mailbox.receive(mailbox) else { return Ok(()) };
        let (protocol, answered) = match request.protocol {
            protocol if protocol == Protocol::CanOpen as u8 && self.al.state().has_objects() => {
                (Protocol::CanOpen, self.object_request(request.payload))
            }
            protocol if protocol == Protocol::File as u8 => {
                (Protocol::File, self.file_request(request.payload))
            }
            protocol if protocol == Protocol::Ethernet as u8 => {
                (Protocol::Ethernet, self.ethernet_request(request.payload))
            }
            _ => (Protocol::Error, Err(MailboxError::UnsupportedProtocol)),
        };
        match answered {
            Ok(Some(response)) => self.mailbox.send(protocol, response),
            Ok(None) => {}
            Err(error) => drop(self.mailbox.refuse::<()>(error)),
        }
        Ok(())
    }

    fn object_request(&mut self, payload: &[u8]) -> Result<Option<Payload>, MailboxError> {
        self.communication.timing.minimum_cycle_ns = self.cycle_ns_min();
        self.communication.timing.copy_ns = self.copy_ns();
        let mut dictionary = Dictionary {
            device: self.device,
            communication: &mut self.communication,
            application: &mut self.application,
            state: self.al.state(),
        };
        self.coe.request(payload, &mut dictionary, self.mailbox.payload_bytes())
    }

    fn file_request(&mut self, payload: &[u8]) -> Result<Option<Payload>, MailboxError> {
        let offered = self.device.files != FileAccess::None;
        let files = offered.then(|| self.application.files()).flatten();
        let files = files.ok_or(MailboxError::UnsupportedProtocol)?;
        self.foe.request(payload, files, self.al.state(), self.mailbox.payload_bytes(), Instant::now())
    }

    fn ethernet_request(&mut self, payload: &[u8]) -> Result<Option<Payload>, MailboxError> {
        let room = self.mailbox.payload_bytes();
        let ethernet = self.ethernet().ok_or(MailboxError::UnsupportedProtocol)?;
        ethernet.request(payload, room, Instant::now())
    }

    /// The next message without a new request: of a file, the rest of a response, or an emergency; and behind all of these, which
    /// are few, a fragment of Ethernet.
    fn next_message(&mut self) -> Option<(Protocol, Payload)> {
        let room = self.mailbox.payload_bytes();
        if let Some(files) = self.application.files()
            && let Some(message) = self.foe.next(files, room, Instant::now())
        {
            return Some((Protocol::File, message));
        }
        if !self.al.state().has_objects() {
            return None;
        }
        let catalogue = Catalogue { device: self.device, application: &self.application };
        let next = self.coe.next(room, &catalogue);
        let next = match next {
            None if self.application.sends_emergencies() => {
                self.application.emergency().map(Emergency::message)
            }
            next => next,
        };
        match next {
            Some(message) => Some((Protocol::CanOpen, message)),
            None => self.ethernet()?.next(room).map(|message| (Protocol::Ethernet, message)),
        }
    }

    async fn give_message(&mut self) -> Result<bool, EscError> {
        // Only once it can go into SM1: a queued message cannot be withdrawn.
        if self.mailbox.is_idle()
            && !self.mailbox.is_occupied()
            && let Some((protocol, payload)) = self.next_message()
        {
            self.mailbox.send(protocol, payload);
        }
        let mut buffer = [0; MAILBOX_BYTES_MAX];
        if !self.mailbox.is_idle() && !self.mailbox.is_occupied() {
            self.let_pulse_pass().await?;
        }
        let Some(message) = self.mailbox.next(&mut buffer) else { return Ok(false) };
        self.esc.write(self.device.memory.start(Channel::MailboxIn), message).await?;
        Ok(true)
    }

    /// Writes the last message into SM1 again (ETG.1000.4, clause 5.6.3: the repeat request).
    pub(super) async fn repeat_message(&mut self, repeat: bool) -> Result<(), EscError> {
        if self.mailbox.is_occupied() {
            // The message in it follows the repeated one.
            self.empty_mailbox().await?;
        }
        let mut buffer = [0; MAILBOX_BYTES_MAX];
        if let Some(message) = self.mailbox.repeat(repeat, &mut buffer) {
            self.esc.write(self.device.memory.start(Channel::MailboxIn), message).await?;
        }
        // Acknowledges the repeat request now that the message is there.
        self.switch(Channel::MailboxIn, true).await
    }

    /// Empties SM1 by switching it off, which takes effect at the end of a frame in progress (register 0807h), and on again.
    async fn empty_mailbox(&mut self) -> Result<(), EscError> {
        let mut control = [0];
        self.switch(Channel::MailboxIn, false).await?;
        for _ in 0..SWITCH_LOOKS_MAX {
            self.esc.read(Channel::MailboxIn.pdi_control(), &mut control).await?;
            if control[0] & PDI_CONTROL_OFF != 0 {
                return self.switch(Channel::MailboxIn, true).await;
            }
            Timer::after(SWITCH_PAUSE).await;
        }
        Err(EscError::Stuck(Channel::MailboxIn.pdi_control()))
    }
}
