//! The process image: exchanges a SyncManager's bytes with the application, PDO by PDO.

use embassy_time::Instant;

use crate::application::Application;
use crate::catalogue::Catalogue;
use crate::communication::Communication;
use crate::device::Device;

/// Default size of a SubDevice's output buffer: both images fit into 4 KiB.
pub const OUTPUTS_BYTES: usize = 512;
/// Default size of the input buffer: as large, plus validity information.
pub const INPUTS_BYTES: usize = 584;

/// The images of both directions, in buffers of fixed size.
#[derive(Debug)]
pub struct Images<const OUTPUTS: usize = OUTPUTS_BYTES, const INPUTS: usize = INPUTS_BYTES> {
    /// The last outputs; meaningful only if they are valid.
    pub outputs: [u8; OUTPUTS],
    /// Whether outputs arrived since SafeOp was entered or the watchdog expired.
    pub outputs_valid: bool,
    /// Outputs arrived that the application has not got yet.
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
    /// Passes the last outputs to the application.
    pub fn hand_out(
        &self,
        device: &'static Device,
        communication: &Communication,
        application: &mut impl Application,
    ) {
        let mut rest = &self.outputs[..];
        for pdo in communication.outputs.indices() {
            // SafeOp is refused if the assignment exceeds the buffer.
            let Some((bytes, behind)) = rest.split_at_checked(pdo_bytes(device, application, pdo)) else {
                return;
            };
            application.outputs(pdo, bytes);
            rest = behind;
        }
    }

    /// Collects the application's inputs.
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
