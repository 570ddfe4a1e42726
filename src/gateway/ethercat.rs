//! The gateway's EtherCAT side: what the SubDevice shares with it, and how its controller is found.

use ethercat_subdevice::esc::EscError;

use super::{Gateway, Status};
use crate::fieldbus::{Controller, EthercatState, LineWriter};
use crate::hal::{OpenError, OpenErrorKind};
use crate::scanner::POINTS;
use crate::settings::{InterfaceName, Settings};

impl<'g> Gateway<'g> {
    /// The gateway of a board with an EtherCAT controller, whose SubDevice has the objects of `port_state`.
    #[must_use]
    pub const fn with_ethercat(mut self, port_state: &'g EthercatState) -> Self {
        self.ethercat = Some(port_state);
        self
    }

    /// The same for a board without one, which is a SubDevice at a network interface that the settings name.
    #[must_use]
    pub const fn with_ethercat_interfaces(mut self, port_state: &'g EthercatState) -> Self {
        self.ethercat_interfaces = true;
        self.with_ethercat(port_state)
    }

    /// What the SubDevice shares, if the board has one.
    pub fn ethercat(&self) -> Option<&'g EthercatState> {
        if POINTS { self.ethercat } else { None }
    }

    /// The network interface that the settings name for the EtherCAT controller.
    pub fn ethercat_interface(&self) -> Option<InterfaceName> {
        self.settings(|settings| settings.ethercat()?.interface.clone())
    }

    /// Whether they want a modular SubDevice there.
    pub fn ethercat_modules(&self) -> bool {
        self.settings(|settings| settings.ethercat().is_some_and(|port| port.modules))
    }

    /// Waits until settings have been taken over that may say otherwise; one task may wait.
    pub async fn new_ethercat_interface(&self) {
        self.ethercat_changed.wait().await;
    }

    /// How the EtherCAT controller is doing that the board has or `settings` lead to.
    pub(crate) fn ethercat_controller(&self, settings: &Settings) -> Option<Controller> {
        let led_to = !self.ethercat_interfaces || settings.ethercat().is_some();
        self.ethercat().filter(|_| led_to).map(EthercatState::controller)
    }

    /// The EtherCAT side of taking `new` settings over.
    pub(super) fn follow_ethercat(&self, new: &Settings, other_slaves: bool) {
        let Some(ethercat) = self.ethercat() else { return };
        let before = ethercat.line_writer();
        ethercat.follow(new, other_slaves);
        let writer = ethercat.line_writer();
        if let (true, LineWriter::SettingsOver(_), Some(line)) =
            (writer != before, writer, new.ethercat_line())
        {
            log_warn!("line {}: {writer}", new.name(line));
        }
        self.ethercat_changed.signal(());
    }
}

/// The status of the port whose controller this is.
impl From<Controller> for Status {
    fn from(controller: Controller) -> Self {
        match controller {
            Controller::Present => Self::Open,
            Controller::Missing(EscError::Unreachable(why))
            | Controller::Lost(EscError::Unreachable(why)) => {
                Self::Failed(OpenError::new(OpenErrorKind::Failed, why))
            }
            Controller::Missing(_) => {
                Self::Failed(OpenError::new(OpenErrorKind::NotFound, "no EtherCAT controller answers"))
            }
            Controller::Lost(_) => Self::Lost,
        }
    }
}
