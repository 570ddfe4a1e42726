//! The process image: how a SyncManager's bytes are handed to the application, PDO by PDO.

use embassy_time::Instant;

use crate::application::Application;
use crate::catalogue::Catalogue;
use crate::communication::Communication;
use crate::device::Device;

/// Bytes of outputs that a SubDevice has a buffer for, unless it is made with another: both images fit into 4 KiB.
pub const OUTPUTS_BYTES: usize = 512;
/// Bytes of inputs, likewise: as many, and some that tell how good they are.
pub const INPUTS_BYTES: usize = 584;

/// The images of both directions, in buffers of so many bytes.
#[derive(Debug)]
pub struct Images<const OUTPUTS: usize = OUTPUTS_BYTES, const INPUTS: usize = INPUTS_BYTES> {
    /// The last outputs; good only if they are valid.
    pub outputs: [u8; OUTPUTS],
    /// Whether outputs have come since SafeOp was entered and the watchdog ran out.
    pub outputs_valid: bool,
    /// Outputs have come that were not handed out.
    pub outputs_due: bool,
    /// When inputs are due in free run.
    pub inputs_due: Instant,
    inputs: [u8; INPUTS],
}

impl<const OUTPUTS: usize, const INPUTS: usize> Default for Images<OUTPUTS, INPUTS> {
    fn default() -> Self {
        Self {
            outputs: [0; OUTPUTS],
            outputs_valid: false,
            outputs_due: false,
            inputs_due: Instant::MIN,
            inputs: [0; INPUTS],
        }
    }
}

impl<const OUTPUTS: usize, const INPUTS: usize> Images<OUTPUTS, INPUTS> {
    /// Hands the last outputs to the application.
    pub fn hand_out(
        &self,
        device: &'static Device,
        communication: &Communication,
        application: &mut impl Application,
    ) {
        let mut rest = &self.outputs[..];
        for pdo in communication.outputs.indices() {
            // SafeOp is not entered with an assignment that is longer than the buffer.
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
