//! The process image: how a SyncManager's bytes are handed to the application, PDO by PDO.

use embassy_time::Instant;

use crate::application::Application;
use crate::assignment::Communication;
use crate::catalogue::Catalogue;
use crate::device::Device;

/// Bytes of outputs at most.
pub const OUTPUTS_BYTES_MAX: usize = 512;
/// Bytes of inputs at most: as many, and some that tell how good they are.
pub const INPUTS_BYTES_MAX: usize = 584;

/// The images of both directions.
#[derive(Debug)]
pub struct Images {
    /// The last outputs; good only if they are valid.
    pub outputs: [u8; OUTPUTS_BYTES_MAX],
    /// Whether outputs have come since SafeOp was entered and the watchdog ran out.
    pub outputs_valid: bool,
    /// Outputs have come that were not handed out.
    pub outputs_due: bool,
    /// When inputs are due in free run.
    pub inputs_due: Instant,
    inputs: [u8; INPUTS_BYTES_MAX],
}

impl Default for Images {
    fn default() -> Self {
        Self {
            outputs: [0; OUTPUTS_BYTES_MAX],
            outputs_valid: false,
            outputs_due: false,
            inputs_due: Instant::MIN,
            inputs: [0; INPUTS_BYTES_MAX],
        }
    }
}

impl Images {
    /// Hands the last outputs to the application.
    pub fn hand_out(
        &self,
        device: &'static Device,
        communication: &Communication,
        application: &mut impl Application,
    ) {
        let mut rest = &self.outputs[..];
        for pdo in communication.outputs.indices() {
            // The assignment is no longer than the plan, and the plan no longer than the buffer.
            let Some((bytes, behind)) = rest.split_at_checked(pdo_bytes(device, application, pdo)) else {
                return;
            };
            application.outputs(pdo, bytes);
            rest = behind;
        }
    }

    /// Gathers the application's inputs.
    pub fn gather(
        &mut self,
        device: &'static Device,
        communication: &Communication,
        application: &mut impl Application,
    ) -> &[u8] {
        let mut rest = &mut self.inputs[..];
        let mut gathered = 0;
        for pdo in communication.inputs.indices() {
            let bytes = pdo_bytes(device, application, pdo);
            let Some((bytes, behind)) = rest.split_at_mut_checked(bytes) else { break };
            application.inputs(pdo, bytes);
            gathered += bytes.len();
            rest = behind;
        }
        self.inputs.get(..gathered).unwrap_or_default()
    }
}

fn pdo_bytes(device: &'static Device, application: &impl Application, pdo: u16) -> usize {
    Catalogue { device, application }.object(pdo).map_or(0, |object| object.pdo_bytes())
}
