//! The controller chip of the gateway's SubDevice: probes until one responds, serves it until it is lost, and probes again.

use embassy_time::{Duration, Timer};
use ethercat_subdevice::application::Application as _;
use ethercat_subdevice::clocks::SyncSignals;
use ethercat_subdevice::device::Device;
use ethercat_subdevice::eoe::Ethernet;
use ethercat_subdevice::esc::{Esc, EscError};
use ethercat_subdevice::foe::FileAccess;
use ethercat_subdevice::sub_device::{RESTART_PAUSE, SubDevice};

use super::application::GatewayObjects;
use super::chip::Controller;
use super::files::GatewayFiles;
use super::modular::MODULAR;
use super::objects::DEVICE;

use super::shared::EthercatState;
#[cfg(feature = "long-images")] // Only for images that serve them.
use super::{modular::LONG_MODULAR, objects::LONG_DEVICE};
use crate::scanner::ScannerState;

/// Interval of probes for a controller that has never responded. A probe takes a few bytes on the bus.
const PROBE_INTERVAL: Duration = Duration::from_secs(1);
/// The same for one that was lost: a MainDevice is waiting for it.
const LOST_PROBE_INTERVAL: Duration = Duration::from_millis(100);

static FIXED: Device = DEVICE;
static WITH_MODULES: Device = MODULAR;
static UPDATABLE: Device = Device { files: FileAccess::WithBoot, ..DEVICE };
static UPDATABLE_WITH_MODULES: Device = Device { files: FileAccess::WithBoot, ..MODULAR };
#[cfg(feature = "long-images")] // Only for images that serve it.
static LONG: Device = LONG_DEVICE;
#[cfg(feature = "long-images")] // Only for images that serve it.
static LONG_WITH_MODULES: Device = LONG_MODULAR;
#[cfg(feature = "long-images")] // Only for images that serve it.
static LONG_WITH_ETHERNET: Device = Device { ethernet: true, ..LONG_DEVICE };
#[cfg(feature = "long-images")] // Only for images that serve it.
static LONG_WITH_BOTH: Device = Device { ethernet: true, ..LONG_MODULAR };

/// The description of the gateway as a SubDevice: with fixed process data, or with modules.
pub fn device(modules: bool) -> &'static Device {
    if modules { &WITH_MODULES } else { &FIXED }
}

/// The same for a board that takes new firmware in Boot.
pub fn updatable_device(modules: bool) -> &'static Device {
    if modules { &UPDATABLE_WITH_MODULES } else { &UPDATABLE }
}

/// The same with long images, and Ethernet by EoE or none.
#[cfg(feature = "long-images")]
pub fn long_device(modules: bool, ethernet: bool) -> &'static Device {
    match (modules, ethernet) {
        (false, false) => &LONG,
        (false, true) => &LONG_WITH_ETHERNET,
        (true, false) => &LONG_WITH_MODULES,
        (true, true) => &LONG_WITH_BOTH,
    }
}

/// The gateway as a SubDevice with buffers for long images.
#[cfg(feature = "long-images")]
#[doc(hidden)] // Public for tests/ only.
pub type LongSubDevice<E, A> = SubDevice<
    E,
    A,
    { LONG_DEVICE.memory.outputs_bytes_max as usize },
    { LONG_DEVICE.memory.inputs_bytes_max as usize },
>;

/// The gateway's EtherCAT task: serves the controller behind `esc` forever, whenever it is present. `points` are the gateway's data
/// points, if any; `files` are a [`FileBuffer`](super::FileBuffer), or [`NoFiles`](ethercat_subdevice::foe::NoFiles);
/// `attention` as for [`SubDevice::run`], and `sync` where the board has the controller's SYNC pins.
pub async fn serve<F: GatewayFiles>(
    shared: &EthercatState,
    points: Option<&ScannerState>,
    files: F,
    esc: impl Esc,
    sync: Option<&'static SyncSignals>,
    attention: impl AsyncFnMut(),
) -> ! {
    let objects = GatewayObjects::new(shared).with_points(points).with_files(files);
    let device = if F::ACCESS == FileAccess::None { device } else { updatable_device };
    let mut sub_device = SubDevice::new(device(false), esc, objects).with_sync(sync);
    run(shared, &mut sub_device, device, attention).await
}

/// The same for a controller with memory for longer images, and a `shared` for them ([`EthercatState::long`]). It has no Boot, so
/// that `files` are the named ones. `ethernet` is an [`Eoe`](ethercat_subdevice::eoe::Eoe), offered where the settings have the word
/// for it, or [`NoEthernet`](ethercat_subdevice::eoe::NoEthernet).
#[cfg(feature = "long-images")] // As `EthercatState::long`.
pub async fn serve_long(
    shared: &EthercatState,
    points: Option<&ScannerState>,
    files: impl GatewayFiles,
    ethernet: impl Ethernet,
    esc: impl Esc,
    sync: Option<&'static SyncSignals>,
    attention: impl AsyncFnMut(),
) -> ! {
    let objects = GatewayObjects::new(shared).with_points(points).with(files, ethernet);
    let mut sub_device = LongSubDevice::with_buffers(long_device(false, false), esc, objects).with_sync(sync);
    let device = |modules| long_device(modules, shared.wants_ethernet());
    run(shared, &mut sub_device, device, attention).await
}

/// Serves as the device that `device` returns for modules or none, as selected by the settings. By reference: a future stores both
/// its arguments and what it moves them to.
async fn run<const OUTPUTS: usize, const INPUTS: usize>(
    shared: &EthercatState,
    sub_device: &mut SubDevice<
        impl Esc,
        GatewayObjects<'_, impl GatewayFiles, impl Ethernet>,
        OUTPUTS,
        INPUTS,
    >,
    device: impl Fn(bool) -> &'static Device,
    mut attention: impl AsyncFnMut(),
) -> ! {
    let mut known = None;
    loop {
        let controller = match (sub_device.esc().look().await, known) {
            (Ok(()), _) => Controller::Present,
            (Err(fault), None | Some(Controller::Missing(_))) => Controller::Missing(fault),
            (Err(fault), _) => Controller::Lost(fault),
        };
        if known != Some(controller) {
            match controller.fault() {
                Some(fault) => log_warn!("{controller}: {fault}"),
                None => log_info!("{controller}"),
            }
            shared.set_controller(controller);
            known = Some(controller);
        }
        let pause = match controller {
            Controller::Present => {
                if sub_device.application().is_another_device() {
                    let device = device(sub_device.application().follow_settings());
                    log_info!("EtherCAT: {}", device.name);
                    sub_device.become_device(device);
                }
                sub_device.run_until_fault(&mut attention).await;
                RESTART_PAUSE
            }
            // A bus that is not usable needs manual intervention.
            Controller::Missing(_) | Controller::Lost(EscError::Unreachable(_)) => PROBE_INTERVAL,
            Controller::Lost(_) => LOST_PROBE_INTERVAL,
        };
        Timer::after(pause).await;
    }
}
