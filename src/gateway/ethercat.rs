//! The gateway's EtherCAT part: the state shared with the SubDevice, and the location of its controller.

use ethercat_subdevice::esc::EscError;

use super::{Gateway, Status};
use crate::fieldbus::{Controller, EthercatState, LineWriter};
use crate::hal::{OpenError, OpenErrorKind};
use crate::scanner::POINTS;
use crate::settings::Settings;

impl<'g> Gateway<'g> {
    /// For boards with an EtherCAT controller; `port_state` is shared with its SubDevice.
    #[must_use]
    pub const fn with_ethercat(mut self, port_state: &'g EthercatState) -> Self {
        self.ethercat = Some(port_state);
        self
    }

    /// For boards without an EtherCAT controller, which become a SubDevice at a network interface named in the settings.
    #[must_use]
    pub const fn with_ethercat_interfaces(mut self, port_state: &'g EthercatState) -> Self {
        self.ethercat_interfaces = true;
        self.with_ethercat(port_state)
    }

    /// The state shared with the SubDevice, if the board has one.
    pub fn ethercat(&self) -> Option<&'g EthercatState> {
        if POINTS { self.ethercat } else { None }
    }

    /// Whether the settings ask for a modular SubDevice.
    pub fn ethercat_modules(&self) -> bool {
        self.settings(|settings| settings.ethercat().is_some_and(|port| port.modules))
    }

    /// Waits until new settings that may change the interface are in force; one task may wait.
    pub async fn new_ethercat_interface(&self) {
        self.ethercat_changed.wait().await;
    }

    /// The status of the EtherCAT controller, on the board or named by `settings`.
    pub(crate) fn ethercat_controller(&self, settings: &Settings) -> Option<Controller> {
        let led_to = !self.ethercat_interfaces || settings.ethercat().is_some();
        self.ethercat().filter(|_| led_to).map(EthercatState::controller)
    }

    /// Applies the EtherCAT part of `new` settings.
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

/// The controller's status as that of a port.
impl From<Controller> for Status {
    fn from(controller: Controller) -> Self {
        match controller {
            Controller::Present => Self::Open,
            Controller::Missing(EscError::Unreachable(why))
            | Controller::Lost(EscError::Unreachable(why)) => {
                Self::Failed(OpenError::new(OpenErrorKind::Failed, why))
            }
            Controller::Missing(_) => {
                Self::Failed(OpenError::new(OpenErrorKind::NotFound, "no EtherCAT controller responds"))
            }
            Controller::Lost(_) => Self::Lost,
        }
    }
}
